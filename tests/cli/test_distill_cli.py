"""The spin-distill command: its errors, and tiny runs in one and in two processes."""

import json
import math
import os
import sys
from types import SimpleNamespace

import hydra
import pytest
import torch
import yaml
from omegaconf import OmegaConf

import spin_rl.tasks.nav.env
from spin_rl.benchmark import settings
from spin_rl.cli import distill, run_folder
from spin_rl.config import ConfigError
from spin_rl.paths import CONF_DIR, POLICY_DIR
from spin_rl.runners import load_policy, policy_file, read_policy
from spin_rl.tasks.common.compose import compose
from spin_rl.tasks.nav.spec import NAV
from spin_rl.tasks.pick.config import PickConfig
from spin_rl.tasks.registry import find_task

TEACHER = f"teacher={POLICY_DIR / 'nav-cvo.safetensors'}"
TINY = [TEACHER, "num_envs=4", "runner.num_steps_per_env=4", "runner.algorithm.freeze_iterations=1"]


def run_options():
    values = compose("train", ["run_dir=here", "device=cpu"])
    return run_folder.read_options(run_folder.RunOptions, values, ())


def run_main(monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["spin-distill", *arguments])
    distill.main()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ([], "teacher: expected the name or path of a policy, got None"),
        (["teacher=nobody"], "teacher: There is no policy 'nobody'"),
        ([TEACHER, "mode=fast"], "mode: unknown 'fast'; choose from sync, async"),
        ([TEACHER, "num_envs=2"], "algorithm.num_mini_batches must be at most the 2 environments"),
        ([TEACHER, "+runner.depth_encoder.size=3"], "depth_encoder.size: unknown key"),
        ([TEACHER, "runner.depth_encoder.kernels=[8]"], "must have the same length"),
        ([TEACHER, "runner.asynchronous.blocks=1"], "asynchronous.blocks must be at least 3"),
        ([TEACHER, "depth.filter.far_m=0.1"], "depth.filter.near_m must be"),
        ([TEACHER, "init=nobody"], "init: There is no policy 'nobody'"),
        ([TEACHER, "init=[nav-cvo]"], "init: expected the name or path of a policy or null, got ['nav-cvo']"),
        ([TEACHER, "max_iterations=0"], "max_iterations: expected a whole number from 1 on"),
        ([TEACHER, "resume=missing"], "no checkpoint at missing"),
    ],
)
def test_bad_input_is_one_line_before_anything_starts(monkeypatch, capfd, tmp_path, arguments, expected):
    def too_late(*_, **__):
        raise AssertionError("worlds were made")

    monkeypatch.setattr(spin_rl.tasks.nav.env, "NavEnv", too_late)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stopped:
        run_main(monkeypatch, *arguments)
    assert stopped.value.code == 2
    error = capfd.readouterr().err.strip()
    assert error.startswith("spin-distill: error: ") and expected in error
    assert "\n" not in error
    assert not list(tmp_path.iterdir())


def test_async_is_not_for_torchrun(monkeypatch, capfd):
    for name, value in {"WORLD_SIZE": "2", "RANK": "0", "LOCAL_RANK": "0"}.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(SystemExit):
        run_main(monkeypatch, *TINY, "mode=async")
    assert "mode: async has two processes of its own" in capfd.readouterr().err


def test_distillation_from_start_to_resume(monkeypatch, capfd, tmp_path, device):
    monkeypatch.chdir(tmp_path)
    run_dir = tmp_path / "student"
    options = [*TINY, f"device={device}", f"run_dir={run_dir}", "depth=d435i"]
    run_main(monkeypatch, *options, "max_iterations=2")
    names = {str(path.relative_to(run_dir)) for path in run_dir.rglob("*.*") if "events" not in path.name}
    assert names == {
        ".lock",
        "config.yaml",
        "summary.json",
        "checkpoints/last.pt",
        "checkpoints/iteration_0000002.pt",
    }
    summary = json.loads((run_dir / "summary.json").read_text())
    assert summary["env_steps"] == 2 * 4 * 4 and summary["loss"] > 0.0
    assert {"env_steps_per_second", "minutes", "success_rate", "seed"} <= set(summary)
    config = yaml.safe_load((run_dir / "config.yaml").read_text())
    assert config["runner"]["obs_groups"]["actor"] == ["proprio", "goal", "depth"]

    # An evaluation knows from the policy that there are images, and how they are filtered.
    metadata = read_policy(run_dir).metadata
    task = NAV.configure(settings.for_policy(compose("eval"), metadata["config"], ()))
    trained = NAV.configure(config)
    assert task.depth.filter == trained.depth.filter and trained.depth.filter.fill_px > 0
    assert task.depth.noise.dropout == 0.0 and trained.depth.noise.dropout > 0.0
    assert metadata["actor"]["depth_encoder"]["image"] == [87, 58]
    assert load_policy(run_dir).encoders["depth"].latent == 16

    run_main(monkeypatch, *options, "max_iterations=3", f"resume={run_dir}")
    assert "Continuing with other settings" not in capfd.readouterr().out
    assert json.loads((run_dir / "summary.json").read_text())["iterations"] == 3


@pytest.fixture
def pick_teacher(tmp_path):
    """An untrained policy of the pick task, as a file; its eyes reach 3 m."""
    with hydra.initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        config = OmegaConf.to_container(hydra.compose("train", ["task=pick", "task.sight.far_m=3.0"]))
    dims = {"proprio": 31, "hand": 7, "object_start": 3, "object": 10}
    description = config["runner"]["actor"]
    torch.manual_seed(0)
    weights = policy_file.build_model(description, "actor", dims, 10).state_dict()
    weights["obs_normalizer._mean"] = torch.randn(1, 51)
    metadata = {
        "version": policy_file.FORMAT_VERSION,
        "obs_groups": list(dims),
        "obs_dims": dims,
        "num_actions": 10,
        "actor": description,
        "config": config,
    } | dict.fromkeys(("env_steps", "iteration", "minutes"), 0)
    path = tmp_path / "pick.safetensors"
    policy_file.write_policy(path, weights, metadata)
    return path


def test_a_student_of_the_pick_task(monkeypatch, capfd, tmp_path, pick_teacher):
    """The task follows from the teacher, and with it scene, physics and groups; its settings are carried.

    The teacher has a range of depths in its configuration, but never saw an image.
    """
    run_dir = tmp_path / "student"
    options = [f"teacher={pick_teacher}", *TINY[1:], f"run_dir={run_dir}", "device=cpu"]
    run_main(monkeypatch, *options, "max_iterations=2")
    config = yaml.safe_load((run_dir / "config.yaml").read_text())
    groups = ["proprio", "hand", "object_start", "depth", "object_at_start", "hand_in_image"]
    assert config["runner"]["obs_groups"]["actor"] == groups
    assert config["runner"]["algorithm"]["latent_loss"] == 0.5
    task = find_task(config["task"]["name"]).configure(config)
    assert isinstance(task, PickConfig)
    assert task.sight.far_m == 3.0 and task.sim.substeps == 8 and task.depth is not None
    assert task.curriculum.start == 1.0 and task.end_on_success
    assert task.depth.filter.far_m == 1.6 and task.noise.object_start_m == 0.008
    student, teacher = load_policy(run_dir), load_policy(pick_teacher)
    assert student.encoders["depth"].latent == 10
    assert student.encoders["depth"].cfg.kernels == (5, 3, 3) and student.encoders["depth"].cfg.reads_flat
    # proprio, hand and object_start; then object_at_start as object, and hand_in_image.
    assert torch.equal(student.obs_normalizer._mean[:, :51], teacher.obs_normalizer._mean)
    assert student.encoders["depth"].shortcut.weight[:, 41:51].diagonal().min() > 0.9
    assert student.encoders["depth"].cfg.hand_window == 24
    run_main(monkeypatch, *options, "max_iterations=3", f"resume={run_dir}")
    assert "Continuing with other settings" not in capfd.readouterr().out
    assert json.loads((run_dir / "summary.json").read_text())["iterations"] == 3


def test_a_student_starts_from_a_policy(monkeypatch, capfd, tmp_path, pick_teacher):
    """Another student's weights or, by default, the teacher's; one of another task does not fit."""
    monkeypatch.chdir(tmp_path)
    options = [f"teacher={pick_teacher}", *TINY[1:], "device=cpu", "max_iterations=1"]
    options += ["runner.further_groups=[]", "runner.depth_encoder.shortcut=false"]
    options.append("runner.depth_encoder.hand_window=0")
    slow = ["runner.algorithm.learning_rate=1e-9", "runner.algorithm.min_learning_rate=1e-9"]
    slow.append("runner.algorithm.freeze_iterations=0")
    run_main(monkeypatch, *options, "run_dir=first", "runner.depth_encoder.reads_flat=false")
    run_main(monkeypatch, *options, *slow, "run_dir=second", "init=first", "seed=2", "depth.filter.far_m=3.0")
    assert (
        "Initialized from first: proprio, hand, object_start, depth, memory; it read depths of 0.2 to 1.6 m, "
        "here they are 0.2 to 3.0 m" in capfd.readouterr().out
    )
    first, second = (load_policy(name).state_dict() for name in ("first", "second"))
    grown = "encoders.depth.mlp.0.weight"
    columns = first[grown].shape[1]
    assert second[grown].shape[1] == columns + 41  # proprio, hand and object_start
    for name, value in second.items():
        if "normalizer" in name:
            continue
        kept = value[:, :columns] if name == grown else value
        torch.testing.assert_close(kept, first[name], rtol=0.0, atol=1e-6, msg=name)
    assert second[grown][:, columns:].abs().max() < 1e-6

    runner = SimpleNamespace(alg=SimpleNamespace(student=load_policy("second")))
    with pytest.raises(ConfigError, match=r"^init: .*nav-cvo.* cannot start the student: its layers of"):
        distill._start_from(runner, read_policy("nav-cvo"))


def test_teachers_of_another_task_are_one_line(monkeypatch, capfd, tmp_path, pick_teacher):
    monkeypatch.chdir(tmp_path)
    for arguments in ([TEACHER, "task=pick"], [f"teacher={pick_teacher}", "task=nav"]):
        with pytest.raises(SystemExit):
            run_main(monkeypatch, *arguments)
        error = capfd.readouterr().err.strip()
        assert error.startswith("spin-distill: error: teacher: ") and "which is not task=" in error
        assert "\n" not in error


@pytest.mark.parametrize(
    ("success", "text", "number"), [(math.nan, "no episode over yet", None), (0.25, "success 0.25", 0.25)]
)
def test_last_line_of_a_run(capsys, tmp_path, success, text, number):
    summary = {"success_rate": success, "env_steps": 1234}
    run_folder.write_results(tmp_path, summary, run_options())
    path = tmp_path / "summary.json"
    assert capsys.readouterr().out == f"Wrote {path}: {text} after 1,234 env steps\n"
    assert json.loads(path.read_text())["success_rate"] == number


@pytest.mark.slow
def test_asynchronous_distillation(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    run_main(monkeypatch, *TINY, "device=cpu", "mode=async", "max_iterations=3", "run_dir=student")
    summary = json.loads((tmp_path / "student" / "summary.json").read_text())
    assert summary["iterations"] == 3 and summary["env_steps"] >= 2 * 4 * 4
    assert load_policy(tmp_path / "student") is not None
    assert "RANK" not in os.environ
