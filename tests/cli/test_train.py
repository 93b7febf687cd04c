"""The spin-train command: its errors, and one tiny training from start to resume."""

import json
import re
import sys

import pytest
import torch
import yaml
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

import spin_rl.tasks.nav.env
from spin_rl.cli import common, train
from spin_rl.config import ConfigError
from spin_rl.paths import CONF_DIR
from spin_rl.tasks.common.compose import with_depth
from spin_rl.tasks.nav.spec import NAV


def run_main(monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["spin-train", *arguments])
    train.main()


@pytest.mark.parametrize(
    ("argument", "expected"),
    [
        ("nonsense=1", "nonsense: unknown key; see spin-train --help"),
        ("task.dificulty=1", "task.dificulty: unknown key; did you mean task.difficulty?"),
        ("+max_minute=1", "max_minute: unknown key; did you mean max_minutes?"),
        ("robot=foo", "robot: unknown 'foo'; choose from paper, re1"),
        ("baseline=fixcam_I", "baseline: is called camera now: camera=fixcam_I"),
        ("task.episode_s=-1", "task.episode_s must exceed"),
        ("task.episode_s=[", "task.episode_s=["),
        ("scene.width=0.1", "scene.width"),
        ("device=cuda:9", "device: cuda:9 is not available here"),
        ("resume=missing", "no checkpoint at missing"),
        ("num_envs=many", "num_envs: expected a whole number from 1 on, got 'many'"),
        ("run_dir=file/inside", "file"),
        ("+runner.algorithm.learning_speed=1.0", "algorithm.learning_speed"),
        ("+camera.tilt=1", "camera: has no settings of its own; choose camera=blind or fixcam_I or"),
        ("--num_envs=16", "--num_envs=16: unknown flag; settings are key=value, without dashes"),
        ("--bogus", "--bogus: unknown flag"),
        ("=5", "=5: expected key=value"),
        ("task=null", "task: expected the name of a file in conf/task, got null"),
        ("seed=1,2", "seed: takes one value at a time; -m runs several"),
    ],
)
def test_bad_input_is_one_line_before_anything_starts(monkeypatch, capfd, tmp_path, argument, expected):
    def too_late(*_, **__):
        raise AssertionError("worlds were made")

    monkeypatch.setattr(spin_rl.tasks.nav.env, "NavEnv", too_late)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    with pytest.raises(SystemExit) as stopped:
        run_main(monkeypatch, argument)
    assert stopped.value.code == 2
    error = capfd.readouterr().err.strip()
    assert error.startswith("spin-train: error: ") and expected in error
    assert "\n" not in error
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_traceback_can_be_asked_for(monkeypatch, capfd):
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")
    with pytest.raises(ConfigError, match="device: cuda:9"):
        run_main(monkeypatch, "device=cuda:9")


@pytest.fixture(scope="module")
def settings():
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        return OmegaConf.to_container(compose("train", ["run_dir=here"]), resolve=True)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("num_envs", 0, "num_envs: expected a whole number from 1 on, got 0"),
        ("num_envs", 2.0, "num_envs: expected a whole number from 1 on, got 2.0"),
        ("num_envs", 2, "runner.algorithm.num_mini_batches must be at most the 2 environments"),
        ("seed", 1.5, "seed: expected a whole number from 0 on, got 1.5"),
        ("max_iterations", 0, "max_iterations: expected a whole number from 1 on"),
        ("max_iterations", None, "max_iterations: expected a whole number from 1 on"),
        ("max_minutes", 0, "max_minutes: expected a positive number or null, got 0"),
        ("max_minutes", float("nan"), "max_minutes: expected a positive number or null"),
        ("max_minutes", "5m", "max_minutes: expected a positive number or null, got '5m'"),
        ("evaluate", True, "evaluate: expected a whole number from 0 on"),
        ("run_dir", None, "run_dir: expected a path, got None"),
        ("resume", 3, "resume: expected a path or null, got 3"),
        ("runner.num_steps_per_env", 0, "runner.num_steps_per_env: expected a whole number from 1"),
        ("runner.steps", 3, "runner.steps is not a setting"),
        ("runner.obs_groups.actor", ["proprio", "radar"], "runner.obs_groups.actor must be of proprio, goal"),
    ],
)
def test_setting_is_checked(settings, key, value, message):
    train.read_options(settings | {"max_minutes": None}, ())
    changed = OmegaConf.create(settings)
    OmegaConf.update(changed, key, value)
    with pytest.raises(ValueError, match=re.escape(message)) as raised:
        train.read_options(OmegaConf.to_container(changed), ())
    assert str(raised.value).startswith(message) and "\n" not in str(raised.value)


def test_learning_from_images_switches_the_camera_on():
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        values = OmegaConf.to_container(compose("train", ["algo=direct_depth", "run_dir=here"]), resolve=True)
    assert NAV.configure(values).depth is None
    values = with_depth(values)
    train.read_options(values, ())
    assert NAV.configure(values).depth is not None
    assert values["runner"]["actor"]["depth_encoder"]["image"] == [87, 58]
    assert not any(group.startswith("scandots") for group in values["runner"]["obs_groups"]["actor"])


def test_devices():
    assert common.resolve_device("cpu") == "cpu"
    assert common.resolve_device("auto") == ("cuda:0" if torch.cuda.is_available() else "cpu")
    for device in ("tpu", "mps", "cpu:0", "cuda:x", "cuda:99", 3):
        with pytest.raises(ConfigError, match="device: "):
            common.resolve_device(device)


def test_training_from_start_to_resume(monkeypatch, capfd, tmp_path, device):
    monkeypatch.chdir(tmp_path)
    run_dir = tmp_path / "runs" / "tiny"
    options = ["num_envs=16", "runner.num_steps_per_env=8", f"device={device}"]
    run_main(monkeypatch, *options, "max_iterations=2", f"run_dir={run_dir}")

    printed = capfd.readouterr().out.strip().splitlines()
    assert printed[0].startswith(f"Starting 16 worlds on {device}")
    assert printed[-1].startswith(f"Wrote {run_dir / 'summary.json'}")
    names = {str(path.relative_to(run_dir)) for path in run_dir.rglob("*") if path.is_file()}
    events = {name for name in names if name.startswith("events.out.tfevents")}
    checkpoints = {"checkpoints/last.pt", "checkpoints/iteration_0000002.pt"}
    assert names - events == {".lock", "config.yaml", "summary.json"} | checkpoints and len(events) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]
    config = yaml.safe_load((run_dir / "config.yaml").read_text())
    assert config["num_envs"] == 16 and config["task"]["name"] == "nav"
    text = (run_dir / "summary.json").read_text()
    assert "NaN" not in text
    summary = json.loads(text)
    assert {"env_steps", "env_steps_per_second", "minutes", "success_rate"} <= set(summary)
    assert summary["env_steps"] == 2 * 8 * 16 and summary["iterations"] == 2
    assert summary["stopped_by"] == "max_iterations" and summary["device"] == device

    # Another run may not overwrite it.
    with pytest.raises(SystemExit) as stopped:
        run_main(monkeypatch, *options, f"run_dir={run_dir}")
    assert stopped.value.code == 2 and f"continue it with resume={run_dir}" in capfd.readouterr().err

    # It goes on in its own folder, and counts on.
    run_main(monkeypatch, *options, "max_iterations=3", f"resume={run_dir}")
    summary = json.loads((run_dir / "summary.json").read_text())
    assert summary["iterations"] == 3 and summary["env_steps"] == 3 * 8 * 16
    assert (run_dir / "checkpoints" / "iteration_0000003.pt").is_file()
    assert [path.name for path in (tmp_path / "runs").iterdir()] == ["tiny"]

    # Or in another one, where that is asked for.
    other = tmp_path / "other"
    run_main(monkeypatch, *options, "max_iterations=4", f"resume={run_dir / 'checkpoints' / 'last.pt'}",
             f"run_dir={other}")  # fmt: skip
    assert json.loads((other / "summary.json").read_text())["iterations"] == 4

    # Where nothing is left to do, its results stay as they are.
    with pytest.raises(SystemExit) as stopped:
        run_main(monkeypatch, *options, "max_iterations=3", f"resume={run_dir}")
    assert stopped.value.code == 2 and "max_iterations: " in capfd.readouterr().err
    assert json.loads((run_dir / "summary.json").read_text()) == summary
