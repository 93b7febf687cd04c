"""What runs meet: full disks, errors, other branches, stopped collectors, launchers that are gone."""

import errno
import os
import signal
import subprocess
import sys
import threading
import time
from functools import partial
from pathlib import Path

import async_jobs
import pytest
import torch
from distill_worlds import DepthEnv, make_student_config
from fake_env import FakeEnv, make_config
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from spin_rl.models.scandot import NORMALIZED_LIMIT
from spin_rl.ranks import Ranks, read_ranks
from spin_rl.runners import PPORunner, checkpoint, find_checkpoint, load_checkpoint, saving
from spin_rl.runners.progress import ScalarWriter
from spin_rl.runners.remote import runner as remote
from spin_rl.runners.remote.runner import AsyncDistillRunner, RemoteEnv


def config(**settings):
    return make_config() | settings


def full_disk(*_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_disk_that_is_full_for_a_time_costs_no_training(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(saving, "RETRY_S", 0.0)
    write, calls = checkpoint.write_atomically, []

    def write_if_there_is_room(path, content):
        calls.append(path)
        (full_disk if 2 < len(calls) < 6 else write)(path, content)

    monkeypatch.setattr(checkpoint, "write_atomically", write_if_there_is_room)
    runner = PPORunner(FakeEnv(), config(save_interval=2), tmp_path)
    assert runner.train(10)["iterations"] == 10
    error = capfd.readouterr().err
    assert error.count("saving is tried again") == 3 and "No space left on device" in error
    assert find_checkpoint(tmp_path)[1]["iteration"] == 10


def test_a_last_checkpoint_that_cannot_be_written_is_told_and_the_good_one_stays(tmp_path, monkeypatch):
    PPORunner(FakeEnv(), config(), tmp_path).train(2)
    runner = PPORunner(FakeEnv(), config(), tmp_path)
    runner.load(tmp_path)
    monkeypatch.setattr(checkpoint, "write_atomically", full_disk)
    with pytest.raises(OSError, match="No space left"):
        runner.train(4)
    assert find_checkpoint(tmp_path)[1]["iteration"] == 2


def test_events_that_cannot_be_written_are_done_without(tmp_path, capfd):
    writer = ScalarWriter(tmp_path, 0)
    writer._writer.add_scalar = full_disk
    for iteration in (1, 2):
        writer.write(iteration, {"a": 1.0})
    writer.close()
    error = capfd.readouterr().err
    assert error.count("no more events are written: No space left on device") == 1


def test_an_error_is_raised_after_what_was_learned_is_saved(tmp_path, capfd):
    env = FakeEnv()
    runner = PPORunner(env, config(), tmp_path)
    step, count = env.step, [0]

    def fail_late(actions):
        count[0] += 1
        if count[0] == 20:
            raise ZeroDivisionError("the world ended")
        return step(actions)

    env.step = fail_late
    with pytest.raises(ZeroDivisionError):
        runner.train(10)
    assert find_checkpoint(tmp_path)[1]["iteration"] == 2
    assert "Saved before the error" in capfd.readouterr().err


def test_weights_that_are_not_finite_never_take_a_good_ones_place(tmp_path):
    runner = PPORunner(FakeEnv(), config(), tmp_path)
    runner.train(1)
    runner.alg.actor.obs_normalizer._mean[0, 0] = torch.nan
    with pytest.raises(FloatingPointError, match=r"actor\.obs_normalizer\._mean is not finite"):
        runner.train(3)
    assert find_checkpoint(tmp_path)[1]["iteration"] == 1


def test_one_wild_observation_does_not_rule_the_normalizer():
    model = PPORunner(FakeEnv(), config()).alg.actor.train()
    obs = FakeEnv().get_observations().clone()
    obs["proprio"][3, 4] = 1e30
    model.update_normalization(obs)
    assert all(value.isfinite().all() for value in model.obs_normalizer.state_dict().values())
    assert model.obs_normalizer.std.max() <= NORMALIZED_LIMIT


def test_a_run_that_goes_back_leaves_the_other_branch_and_its_events(tmp_path, capfd):
    PPORunner(FakeEnv(), config(save_interval=2), tmp_path).train(6)
    runner = PPORunner(FakeEnv(), config(save_interval=1), tmp_path)
    runner.load(tmp_path / "checkpoints" / "iteration_0000002.pt")
    runner.train(4)
    assert capfd.readouterr().out.count("Set aside, of another branch: ") == 3
    last = tmp_path / "checkpoints" / "last.pt"
    last.unlink()
    last.write_bytes(b"torn")
    assert find_checkpoint(tmp_path)[1]["iteration"] == 4
    kept = tmp_path / "checkpoints" / checkpoint.SET_ASIDE
    assert load_checkpoint(kept / "iteration_0000006.pt")["iteration"] == 6


def test_the_events_of_the_checkpoint_stay(tmp_path):
    PPORunner(FakeEnv(), config(), tmp_path).train(4)
    time.sleep(1.0)  # TensorBoard reads files in the order of the seconds in their names
    runner = PPORunner(FakeEnv(), config(), tmp_path)
    runner.load(tmp_path)
    runner.train(7)
    events = EventAccumulator(str(tmp_path)).Reload().Scalars("Perf/env_steps")
    assert [event.step for event in events] == [1, 2, 3, 4, 5, 6, 7]


@pytest.mark.parametrize(
    ("variables", "expected"),
    [
        ({}, Ranks()),
        ({"RANK": "1"}, Ranks()),
        ({"RANK": "x", "WORLD_SIZE": "1"}, Ranks()),
        ({"RANK": "1", "LOCAL_RANK": "0", "WORLD_SIZE": "2"}, Ranks(2, 1, 0)),
        ({"RANK": "2", "LOCAL_RANK": "0", "WORLD_SIZE": "2"}, "RANK: expected 0 to 1"),
        ({"LOCAL_RANK": "0", "WORLD_SIZE": "2"}, "RANK: expected a whole number"),
        ({"WORLD_SIZE": "two"}, "WORLD_SIZE: expected a whole number"),
        ({"WORLD_SIZE": "0"}, "WORLD_SIZE: expected at least 1"),
    ],
)
def test_ranks_count_in_a_group_only(monkeypatch, variables, expected):
    for name in ("RANK", "LOCAL_RANK", "WORLD_SIZE"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    if isinstance(expected, Ranks):
        assert read_ranks() == expected
    else:
        with pytest.raises(ValueError, match=expected):
            read_ranks()


@pytest.fixture
def stopped_collector(tmp_path, processes, monkeypatch):
    """An asynchronous run whose collector stops in the middle of it."""
    monkeypatch.setattr(remote, "_PATIENCE_S", 0.5)
    monkeypatch.setattr(remote, "_REPORT_S", 0.2)
    teacher = tmp_path / "teacher"
    PPORunner(DepthEnv(), make_config(), teacher).train(1)
    env = RemoteEnv(partial(async_jobs.make_env, delay_s=0.01), "cpu", processes)
    runner = AsyncDistillRunner(env, make_student_config(teacher) | {"asynchronous": {}}, tmp_path / "run")

    def stop_it():
        while runner.current_learning_iteration < 2:
            time.sleep(0.01)
        os.kill(env.pid, signal.SIGSTOP)

    threading.Thread(target=stop_it, daemon=True).start()
    return runner


@pytest.mark.parametrize("end", ["SIGINT", "max_minutes"])
def test_a_collector_that_hangs_keeps_no_learner_from_ending(stopped_collector, tmp_path, capfd, end):
    minutes = 4.0 / 60.0 if end == "max_minutes" else None
    if end == "SIGINT":
        timer = threading.Timer(3.0, lambda: os.kill(os.getpid(), signal.SIGINT))
        timer.start()
    summary = stopped_collector.train(1_000_000, minutes)
    assert summary["stopped_by"] == end and summary["iterations"] >= 2
    assert "Still waiting for the collecting process" in capfd.readouterr().out
    assert load_checkpoint(tmp_path / "run" / "checkpoints" / "last.pt")["iteration"] == summary["iterations"]
    assert not stopped_collector.env._process.is_alive()


def is_running(pid):
    """Whether a process is there; one that nobody has waited for is not."""
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except FileNotFoundError:
        return False


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="looks at /proc")
def test_no_worker_outlives_its_launcher(tmp_path):
    job = Path(__file__).with_name("training_jobs.py")
    command = [sys.executable, "-m", "torch.distributed.run", "--nproc-per-node=2", "--standalone",
               str(job), str(tmp_path)]  # fmt: skip
    launcher = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 120.0
    while len([*tmp_path.glob("pid_*")]) < 2 or not [*tmp_path.glob("events*")]:
        assert time.monotonic() < deadline and launcher.poll() is None
        time.sleep(0.05)
    workers = [int(path.name.removeprefix("pid_")) for path in tmp_path.glob("pid_*")]
    launcher.kill()
    launcher.wait()
    while any(map(is_running, workers)):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    assert find_checkpoint(tmp_path)[1]["iteration"] >= 1
