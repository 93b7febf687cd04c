"""Distillation runs in one and in two processes: results, resuming, and ends of all kinds."""

import os
import shutil
import signal
import time
from functools import partial

import async_jobs
import pytest
import torch
from distill_worlds import DepthEnv, make_student_config
from fake_env import make_config
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from spin_rl.runners import PPORunner, load_checkpoint, load_policy, save_policy
from spin_rl.runners.distillation.runner import DistillRunner
from spin_rl.runners.distillation.sequences import mean_actions
from spin_rl.runners.remote.runner import AsyncDistillRunner, CollectorError, RemoteEnv

DEADLINE_S = 60.0


@pytest.fixture(scope="module")
def teacher(tmp_path_factory):
    folder = tmp_path_factory.mktemp("teacher")
    PPORunner(DepthEnv(), make_config(), folder).train(2)
    return folder


def weights(runner):
    return runner.alg.student.state_dict()


def assert_same_bits(left, right):
    assert left.keys() == right.keys()
    for name in left:
        assert torch.equal(left[name], right[name]), name


def test_resumed_run_equals_an_uninterrupted_one(tmp_path, teacher):
    """Over the end of the frozen phase, with episodes under way and both memories in use."""
    cfg = make_student_config(teacher, schedule="linear") | {"save_interval": 2}
    whole = DistillRunner(DepthEnv(), cfg, tmp_path)
    summary = whole.train(5)
    assert summary["iterations"] == 5 and summary["env_steps"] == 5 * 8 * 12 and summary["loss"] > 0.0
    second = DistillRunner(DepthEnv(seed=99), cfg | {"seed": 99})
    second.load(tmp_path / "checkpoints" / "iteration_0000002.pt")
    assert second.alg.actor_is_frozen
    second.train(5)
    assert_same_bits(weights(second), weights(whole))
    assert second.alg.learning_rate == whole.alg.learning_rate and not second.alg.actor_is_frozen


@pytest.mark.parametrize(("schedule", "expected"), [("fixed", 2e-4), ("linear", 2e-4 - 1e-4 * 2 / 3)])
def test_a_resumed_run_takes_the_learning_rate_that_is_given(tmp_path, teacher, schedule, expected):
    DistillRunner(DepthEnv(), make_student_config(teacher, schedule=schedule), tmp_path).train(1)
    settings = {"schedule": schedule, "learning_rate": 2e-4, "min_learning_rate": 1e-4}
    runner = DistillRunner(DepthEnv(), make_student_config(teacher, **settings))
    runner.load(tmp_path)
    runner.train(3)
    assert runner.alg.optimizer.param_groups[0]["lr"] == runner.alg.learning_rate == pytest.approx(expected)


@pytest.fixture
def growing_teacher(tmp_path, teacher):
    """A teacher's run, and what lets it go on."""
    folder = tmp_path / "teacher"
    shutil.copytree(teacher, folder)

    def train_on():
        runner = PPORunner(DepthEnv(), make_config(learning_rate=1e-2), folder)
        runner.load(folder)
        runner.train(4)

    return folder, train_on


def test_a_teacher_that_has_changed_is_refused_on_resume(tmp_path, growing_teacher):
    folder, train_on = growing_teacher
    DistillRunner(DepthEnv(), make_student_config(folder), tmp_path).train(1)
    copied = tmp_path / "teacher.safetensors"
    save_policy(copied, folder)
    train_on()
    runner = DistillRunner(DepthEnv(), make_student_config(folder))
    with pytest.raises(ValueError, match="teacher: its weights are not those that this run") as error:
        runner.load(tmp_path)
    assert "\n" not in str(error.value)
    same = DistillRunner(DepthEnv(), make_student_config(copied))  # whatever the file's name
    same.load(tmp_path)
    assert same.train(2)["iterations"] == 2


def test_a_run_leaves_a_policy_and_events(tmp_path, teacher):
    runner = DistillRunner(DepthEnv(), make_student_config(teacher, freeze_iterations=1), tmp_path)
    summary = runner.train(2)
    events = EventAccumulator(str(tmp_path)).Reload()
    assert [event.step for event in events.Scalars("Loss/actions")] == [1, 2]
    assert [event.value for event in events.Scalars("Loss/actor_is_frozen")] == [1.0, 0.0]
    assert events.Scalars("Loss/actions")[-1].value == pytest.approx(summary["loss"])
    save_policy(tmp_path / "student.safetensors", tmp_path)
    obs = DepthEnv().get_observations()
    expected = weights(runner)
    for source in (tmp_path, tmp_path / "student.safetensors"):
        policy = load_policy(source, obs)
        assert_same_bits(policy.state_dict(), expected)
        assert policy(obs).shape == (12, 2)


def test_checkpoint_of_phase_1_is_no_distillation(tmp_path, teacher):
    with pytest.raises(ValueError, match="of another algorithm"):
        PPORunner(DepthEnv(), make_config()).load(save_run(tmp_path, teacher))
    with pytest.raises(ValueError, match="encoders"):
        DistillRunner(DepthEnv(), make_student_config(teacher)).load(teacher)


def save_run(folder, teacher):
    DistillRunner(DepthEnv(), make_student_config(teacher), folder).train(1)
    return folder


@pytest.mark.parametrize(
    ("section", "key", "value", "message"),
    [
        (None, "critic", {}, r"runner\.critic is not a setting"),
        ("algorithm", "teacher", None, "teacher: expected the name or path"),
        ("algorithm", "gamma", 0.9, r"algorithm\.gamma is not a setting"),
        ("algorithm", "freeze_iterations", -1, r"algorithm\.freeze_iterations: expected a whole number"),
        ("algorithm", "latent_loss", -0.1, r"algorithm\.latent_loss: expected a number from 0"),
        (
            "algorithm",
            "schedule",
            "adaptive",
            r"algorithm\.schedule: unknown .adaptive.; choose from fixed",
        ),
        ("algorithm", "num_mini_batches", 13, "at most the 12 environments"),
        (None, "asynchronous", {"reuse": 1}, r"asynchronous\.reuse: unknown key"),
        ("obs_groups", "actor", ["proprio", "lidar"], r"obs_groups\.actor .* not 'lidar'"),
    ],
)
def test_errors_of_configuration_are_named_at_start(teacher, section, key, value, message):
    cfg = make_student_config(teacher)
    (cfg if section is None else cfg[section])[key] = value
    with pytest.raises(ValueError, match=message) as error:
        DistillRunner(DepthEnv(), cfg)
    assert "\n" not in str(error.value)


@pytest.fixture
def make_async(teacher, processes):
    """Makes asynchronous runs, with the settings of their ring and of their environment."""

    def make(folder=None, ring=None, **options):
        env = RemoteEnv(partial(async_jobs.make_env, **options), "cpu", processes)
        return AsyncDistillRunner(env, make_student_config(teacher) | {"asynchronous": ring or {}}, folder)

    return make


def is_running(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def wait_until(condition):
    deadline = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_two_processes_from_start_to_resume(tmp_path, teacher, make_async):
    """Many times around the ring, within its bounds, and on from the checkpoint."""
    runner = make_async(tmp_path, {"blocks": 3, "max_staleness": 2, "max_reuse": 2})
    pid, first = runner.env.pid, {name: value.clone() for name, value in weights(runner).items()}
    summary = runner.train(24)
    assert not is_running(pid)
    assert summary["iterations"] == 24
    rollouts = summary["env_steps"] / (8 * 4)
    assert rollouts >= 12  # each used twice at most, in three places
    events = EventAccumulator(str(tmp_path)).Reload()
    assert max(event.value for event in events.Scalars("Async/staleness")) <= 2
    assert max(event.value for event in events.Scalars("Async/uses")) <= 2
    moved = [name for name, value in weights(runner).items() if not torch.equal(value, first[name])]
    assert "lstm.rnn.weight_hh_l0" in moved and "encoders.depth.mlp.0.weight" in moved

    one_process = DistillRunner(DepthEnv(num_envs=4), make_student_config(teacher))
    one_process.load(tmp_path)
    assert_same_bits(weights(one_process), weights(runner))
    assert one_process.train(25)["iterations"] == 25

    resumed = make_async(tmp_path)
    state = resumed.load(tmp_path)
    assert_same_bits(weights(resumed), weights(runner))
    assert state["processes"][0]["env"]["steps"] >= 8 * 12
    summary = resumed.train(25)
    assert summary["iterations"] == 25 and summary["env_steps"] > rollouts * 8 * 4


def test_the_collector_acts_as_the_learner_would(teacher, processes, monkeypatch):
    """With the learner's weights unchanged, a replay of what arrives gives the actions that were taken."""
    env = RemoteEnv(async_jobs.make_recording_env, "cpu", processes)
    runner = AsyncDistillRunner(env, make_student_config(teacher) | {"asynchronous": {"max_reuse": 1}})
    student, errors = runner.alg.student, []

    def replay(block):
        with torch.no_grad():
            x = student.encode(block.observations)
            actions = mean_actions(student, student.decode(x, hidden_state=block.state, resets=block.resets))
        rollouts = env.state_dict()["history"].unflatten(0, (-1, 8))
        errors.append((rollouts - actions).abs().amax(dim=(1, 2, 3)).min().item())
        return {"skipped_steps": 0.0}

    monkeypatch.setattr(runner.alg, "learn", replay)
    runner.train(3)
    assert len(errors) == 3 and max(errors) < 1e-5


def test_both_processes_have_the_same_teacher(growing_teacher, processes, monkeypatch):
    """Also if its run goes on while the environment is made."""
    folder, train_on = growing_teacher
    runner = AsyncDistillRunner(RemoteEnv(async_jobs.make_env, "cpu", processes), make_student_config(folder))
    expected = runner.alg.teacher(runner.env.get_observations()).clamp(-1.0, 1.0)
    train_on()
    targets = []

    def note(block):
        targets.append(block.targets[0].clone())
        return {"skipped_steps": 0.0}

    monkeypatch.setattr(runner.alg, "learn", note)
    runner.train(1)
    torch.testing.assert_close(targets[0], expected)


def test_the_learner_has_no_memory_for_a_rollout_of_its_own(make_async):
    runner = make_async()
    assert all(tensor.is_meta for tensor in runner.alg.sequences.tensors())
    assert runner.train(1)["iterations"] == 1


def test_a_collector_that_is_gone_before_it_begins_is_named(tmp_path, make_async):
    runner = make_async(tmp_path)
    os.kill(runner.env.pid, signal.SIGKILL)
    wait_until(lambda: not is_running(runner.env.pid))
    with pytest.raises(CollectorError, match="The collecting process ended, exit code -9"):
        runner.train(5)
    assert load_checkpoint(tmp_path / "checkpoints" / "last.pt")["iteration"] == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"fails_at": 20}, "The collecting process failed: ArithmeticError: the world ended"),
        ({"dies_at": 20}, "The collecting process ended, exit code -9"),
    ],
)
def test_end_of_the_collector_is_named_and_the_work_is_saved(tmp_path, capfd, make_async, options, message):
    runner = make_async(tmp_path, {"max_reuse": 1}, **options)
    pid = runner.env.pid
    with pytest.raises(CollectorError, match=message):
        runner.train(1_000_000)
    assert not is_running(pid)
    assert load_checkpoint(tmp_path / "checkpoints" / "last.pt")["iteration"] >= 1


def test_an_environment_that_cannot_be_made_is_named(capfd, processes):
    with pytest.raises(CollectorError, match="failed: OSError: there is no world"):
        RemoteEnv(async_jobs.fail_to_make_env, "cpu", processes)


def test_an_error_of_the_learner_ends_the_collector(make_async, monkeypatch):
    runner = make_async()
    monkeypatch.setattr(runner.alg, "learn", lambda sequences: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        runner.train(5)
    assert not is_running(runner.env.pid)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_no_collector_outlives_its_learner(tmp_path, teacher, processes, number):
    process = processes.Process(target=async_jobs.train_for_ever, args=(teacher, tmp_path))
    process.start()
    wait_until(lambda: list(tmp_path.glob("events*")))
    collector = int((tmp_path / "collector").read_text())
    assert is_running(collector)
    os.kill(process.pid, number)
    process.join(DEADLINE_S)
    assert process.exitcode == (0 if number == signal.SIGTERM else -number)
    wait_until(lambda: not is_running(collector))
    assert (tmp_path / "checkpoints" / "last.pt").exists() == (number == signal.SIGTERM)
