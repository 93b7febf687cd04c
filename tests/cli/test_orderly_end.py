"""Folders that are taken or cannot be, and Ctrl-C at any time: one line, and what was finished is kept."""

import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from filelock import FileLock

from spin_rl.benchmark import rounds
from spin_rl.benchmark.metrics import Episodes
from spin_rl.cli import common, run_folder, train
from spin_rl.config import ConfigError
from spin_rl.runners.checkpoint import save_numbered
from spin_rl.tasks.common.compose import compose


def options(run_dir, *overrides):
    values = compose("train", ["run_dir=x", "device=cpu", *overrides]) | {"run_dir": str(run_dir)}
    return run_folder.read_options(run_folder.RunOptions, values, [f"run_dir={run_dir}"])


def claim(run_dir, checkpoint=None):
    with run_folder.claimed(options(run_dir), checkpoint) as path:
        return path


def test_a_folder_belongs_to_one_run_at_a_time(tmp_path):
    with FileLock(tmp_path / ".lock"), pytest.raises(ConfigError, match="is in use by another training"):
        claim(tmp_path)
    assert claim(tmp_path) == claim(tmp_path) == tmp_path


def test_another_runs_folder_is_refused(tmp_path):
    own, other = tmp_path / "own", tmp_path / "other"
    for run in (own, other):
        save_numbered(run / "checkpoints", 3, {})
    checkpoint = own / "checkpoints" / "last.pt"
    with pytest.raises(ConfigError, match="holds another run than"):
        claim(other, checkpoint)
    with pytest.raises(ConfigError, match="holds a run; continue it with resume="):
        claim(own)
    assert claim(own, checkpoint) == own and claim(tmp_path / "new", checkpoint) == tmp_path / "new"


@pytest.mark.parametrize("place", ["/etc/passwd", "/proc/none", "a" * 300, "file/below"])
def test_a_folder_that_cannot_be_is_named(tmp_path, monkeypatch, place):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match=r"^run_dir: cannot write to ") as error:
        claim(place)
    assert "\n" not in str(error.value)


def test_a_refused_run_leaves_no_folder(tmp_path):
    for path in (tmp_path / "new", tmp_path):
        with pytest.raises(ConfigError), run_folder.claimed(options(path), None):
            raise ConfigError("init: fits not")
    assert [path.name for path in tmp_path.iterdir()] == [".lock"]


def test_no_folder_is_no_name():
    with pytest.raises(ConfigError, match="run_dir: expected a path, got ''"):
        options("")


def test_what_a_killed_run_left_beside_its_checkpoints_is_removed(tmp_path):
    (tmp_path / "checkpoints").mkdir()
    left = tmp_path / "checkpoints" / ".last.pt.1.ab.tmp"
    left.touch()
    claim(tmp_path)
    assert not left.exists()


@pytest.mark.parametrize("signalled", ["during", "asked to stop", "not at all"])
def test_a_sweep_ends_with_the_job_that_was_stopped(monkeypatch, capfd, tmp_path, signalled):
    monkeypatch.chdir(tmp_path)
    jobs = []

    def job(call):
        jobs.append(call.values["seed"])
        if signalled == "during":
            raise KeyboardInterrupt
        return signalled == "asked to stop"

    monkeypatch.setattr(sys, "argv", ["spin-train", "-m", "seed=1,2,3", "run_dir=r-${seed}"])
    keys = common.keys_of(train.Options, common.GROUPS)
    if signalled == "not at all":
        common.run("train", job, lambda given: (given, None), keys)
        assert jobs == [1, 2, 3]
        return
    with pytest.raises(SystemExit) as end:
        common.run("train", job, lambda given: (given, None), keys)
    assert end.value.code == common.INTERRUPTED and jobs == [1]
    assert capfd.readouterr().err.count("\n") <= 2


def test_an_interrupted_evaluation_keeps_the_seeds_that_are_finished(monkeypatch):
    class Env:
        device = "cpu"
        health = type("Health", (), {"clear": lambda self: None, "read": lambda self: {}})()

        def get_observations(self):
            return None

        def reseed(self, seed):
            self.seed = seed - rounds.SEED_OFFSET

    def run_seed(env, policy, report):
        if env.seed == 7:
            raise KeyboardInterrupt
        return [Episodes(np.array([1, env.seed]), np.array([3, 4]))]

    def run(seeds):
        return rounds.run_seeds(lambda n: Env(), lambda obs, device: None, run_seed, 2, seeds, "cpu")

    groups, facts = run([2, 7, 3])
    assert groups[0].outcome.tolist() == [1, 2]
    assert facts["seeds"] == [2] and facts["stopped"]
    assert "stopped" not in run([2, 3])[1]
    with pytest.raises(KeyboardInterrupt):
        run([7])


@pytest.mark.slow
def test_ctrl_c_while_a_command_starts_is_one_line(tmp_path):
    command = [sys.executable, "-m", "spin_rl.cli.train", "num_envs=16", "device=cpu", f"run_dir={tmp_path}"]
    process = subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # tests in the background ignore it
    )
    deadline = time.monotonic() + 60.0
    while not (tmp_path / ".lock").exists():  # it has read its configuration and makes its worlds
        assert time.monotonic() < deadline and process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    error = process.communicate(timeout=60.0)[1]
    assert process.returncode == common.INTERRUPTED
    assert error.strip().splitlines() == ["spin-train: interrupted"]
