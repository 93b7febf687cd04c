"""The training loop: limits, signals, resuming, repeatability, errors at start."""

import copy
import os
import signal
import sys
import time

import pytest
import torch
import training_jobs
from fake_env import FakeEnv, make_config
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from spin_rl.runners import PPORunner, load_checkpoint
from spin_rl.runners.config import import_own_classes


def parameters(runner):
    return {
        **runner.alg.actor.state_dict(),
        **{f"c.{k}": v for k, v in runner.alg.critic.state_dict().items()},
    }


def assert_same_bits(left, right):
    assert left.keys() == right.keys()
    for name in left:
        assert torch.equal(left[name], right[name]), name


@pytest.mark.parametrize("schedule", ["adaptive", "linear"])
@pytest.mark.parametrize("critic", ["feed_forward", "recurrent"])
def test_resumed_run_equals_an_uninterrupted_one(tmp_path, critic, schedule):
    cfg = make_config(critic, schedule=schedule)
    whole = PPORunner(FakeEnv(), cfg)
    whole.train(6)

    cfg["save_interval"] = 3
    first = PPORunner(FakeEnv(), cfg, tmp_path)
    first.train(6)  # its checkpoint of iteration 3 is where an interruption would have left it
    second = PPORunner(FakeEnv(seed=99), cfg | {"seed": 99})
    second.load(tmp_path / "checkpoints" / "iteration_0000003.pt")
    summary = second.train(6)

    assert summary["iterations"] == 6 and summary["env_steps"] == 6 * 8 * 12
    assert_same_bits(parameters(first), parameters(whole))
    assert_same_bits(parameters(second), parameters(whole))
    assert second.alg.learning_rate == whole.alg.learning_rate


def test_a_resumed_run_takes_the_learning_rate_that_is_given(tmp_path):
    PPORunner(FakeEnv(), make_config(schedule="fixed"), tmp_path).train(1)
    runner = PPORunner(FakeEnv(), make_config(schedule="fixed", learning_rate=2e-4))
    runner.load(tmp_path)
    runner.train(2)
    assert runner.alg.optimizer.param_groups[0]["lr"] == runner.alg.learning_rate == 2e-4


def test_same_seed_gives_the_same_bits_and_another_seed_does_not():
    runs = []
    for seed in (3, 3, 4):
        runs.append(PPORunner(FakeEnv(), make_config() | {"seed": seed}))
        runs[-1].train(3)
    assert_same_bits(parameters(runs[0]), parameters(runs[1]))
    assert not torch.equal(parameters(runs[0])["mlp.0.weight"], parameters(runs[2])["mlp.0.weight"])


def test_training_learns():
    runner = PPORunner(FakeEnv(num_envs=32), make_config(learning_rate=3e-3, schedule="fixed"))
    before = runner.train(3)
    after = runner.train(60)
    assert after["mean_length_s"] < 0.7 * before["mean_length_s"]


def test_limit_of_time_and_what_is_written(tmp_path, capsys):
    runner = PPORunner(FakeEnv(), make_config() | {"save_minutes": 0.1 / 60}, tmp_path)
    summary = runner.train(1_000_000, max_minutes=1.0 / 60)
    assert summary["stopped_by"] == "max_minutes"
    assert 0.5 / 60 < summary["minutes"] < 2.0 / 60
    assert summary["env_steps"] == summary["iterations"] * 8 * 12
    assert len(list((tmp_path / "checkpoints").glob("iteration_*.pt"))) == 3
    assert load_checkpoint(tmp_path / "checkpoints" / "last.pt")["iteration"] == summary["iterations"]
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("iteration 1 | ") and lines[0].endswith(" left")
    assert lines[-1].startswith("Stopped by max_minutes") and lines[-1].endswith("last.pt")

    events = EventAccumulator(str(tmp_path)).Reload()
    tags = events.Tags()["scalars"]
    assert {
        "Loss/surrogate",
        "Loss/value",
        "Loss/learning_rate",
        "Loss/skipped_steps",
        "Episode/success_rate",
        "Episode/level",
        "Train/mean_reward",
        "Policy/mean_std",
        "Perf/total_fps",
        "Perf/collection_time",
        "Perf/learning_time",
    } <= set(tags)
    assert events.Scalars("Loss/value")[-1].step == summary["iterations"]
    assert events.Scalars("Episode/success_rate/env_steps")[-1].step <= summary["env_steps"]


def test_a_finished_run_is_not_trained_further(tmp_path):
    runner = PPORunner(FakeEnv(), make_config(), tmp_path)
    runner.train(2)
    before = copy.deepcopy(parameters(runner))
    assert runner.train(2)["stopped_by"] == "max_iterations"
    assert_same_bits(parameters(runner), before)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_saves_and_ends_the_run(tmp_path, processes, number):
    process = processes.Process(target=training_jobs.train_until_signalled, args=(tmp_path,))
    process.start()
    deadline = time.monotonic() + 30.0
    while not list(tmp_path.glob("events.*")):  # it is training then, and signals are handled
        assert time.monotonic() < deadline
        time.sleep(0.01)
    time.sleep(0.3)
    assert not (tmp_path / "checkpoints").exists()
    os.kill(process.pid, number)
    process.join(20.0)
    assert process.exitcode == 0
    assert load_checkpoint(tmp_path / "checkpoints" / "last.pt")["iteration"] >= 1


def test_a_second_signal_ends_the_process_at_once(tmp_path, processes):
    process = processes.Process(target=training_jobs.train_and_hang, args=(tmp_path,))
    process.start()
    deadline = time.monotonic() + 30.0
    while not (tmp_path / "hanging").exists():
        assert time.monotonic() < deadline
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGINT)
    time.sleep(0.2)
    os.kill(process.pid, signal.SIGINT)  # passed on by a launcher: the same request
    time.sleep(1.1)
    assert process.is_alive()
    os.kill(process.pid, signal.SIGINT)
    process.join(10.0)
    assert process.exitcode == -signal.SIGINT


def test_bad_rollouts_are_counted_and_survived():
    runner = PPORunner(FakeEnv(poisoned_steps=(10,)), make_config())
    summary = runner.train(4)
    assert summary["skipped_steps"] == 6  # all of one iteration's
    assert all(value.isfinite().all() for value in parameters(runner).values())


@pytest.mark.parametrize(
    ("section", "key", "value", "message"),
    [
        (None, "save_intervall", 1, r"runner\.save_intervall is not a setting"),
        (None, "num_steps_per_env", 0, r"runner\.num_steps_per_env: expected a whole number from 1 to"),
        (None, "save_minutes", -1.0, r"runner\.save_minutes"),
        ("obs_groups", "actor", ["proprio", "lidar"], r"obs_groups\.actor .* not 'lidar'"),
        ("obs_groups", "critics", ["proprio"], r"obs_groups\.critics is not a setting"),
        ("actor", "rnn_hiden_dim", 64, r"actor\.rnn_hiden_dim is not a setting"),
        ("actor", "class_name", "spin_rl.models:Transformer", r"actor\.class_name: there is no"),
        ("actor", "class_name", "rsl_rl.models:RNNModel", r"actor\.class_name must be a .*ScandotModel"),
        ("actor", "distribution_cfg", None, r"actor\.distribution_cfg must be given"),
        (
            "actor",
            "distribution_cfg",
            {"class_name": "GaussianDistribution", "std": 1},
            r"distribution_cfg\.std ",
        ),
        (
            "actor",
            "distribution_cfg",
            {"class_name": "subprocess:Popen"},
            r"distribution_cfg\.class_name must",
        ),
        ("algorithm", "num_epochs", 3, r"algorithm\.num_epochs is not a setting"),
        ("algorithm", "gamma", 1.5, r"algorithm\.gamma: expected a positive number up to 1"),
        ("algorithm", "schedule", "cosine", r"algorithm\.schedule: unknown .cosine"),
        ("algorithm", "num_mini_batches", 13, r"at most the 12 environments"),
        ("algorithm", "learning_rate", "fast", r"algorithm\.learning_rate: expected a positive number"),
    ],
)
def test_errors_of_configuration_are_named_at_start(section, key, value, message):
    cfg = make_config()
    (cfg if section is None else cfg[section])[key] = value
    with pytest.raises(ValueError, match=message) as error:
        PPORunner(FakeEnv(), cfg)
    assert "\n" not in str(error.value)


def test_a_model_of_ones_own_is_imported_when_it_is_asked_for(monkeypatch, tmp_path):
    (tmp_path / "own_models.py").write_text(
        "from spin_rl.models import ScandotRecurrentModel\nclass OwnActor(ScandotRecurrentModel): pass\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    cfg = make_config()
    cfg["actor"]["class_name"] = "own_models:OwnActor"
    with pytest.raises(ValueError, match=r"actor\.class_name must be .* a module that is imported"):
        PPORunner(FakeEnv(), cfg)
    import_own_classes(cfg)
    assert type(PPORunner(FakeEnv(), cfg).alg.actor).__name__ == "OwnActor"
    cfg["actor"]["class_name"] = "no_models:OwnActor"
    with pytest.raises(ValueError, match=r"runner\.actor\.class_name: no_models:OwnActor: No module"):
        import_own_classes(cfg)
    sys.modules.pop("own_models")


@pytest.mark.parametrize(("iterations", "minutes"), [(0, None), (5, 0.0), (5, float("nan"))])
def test_impossible_limits_are_errors(iterations, minutes):
    with pytest.raises(ValueError, match="must be a positive"):
        PPORunner(FakeEnv(), make_config()).train(iterations, minutes)


def test_checkpoint_of_another_architecture_is_refused(tmp_path):
    PPORunner(FakeEnv(), make_config(), tmp_path).train(1)
    cfg = make_config()
    cfg["actor"] = cfg["actor"] | {"rnn_hidden_dim": 32}
    with pytest.raises(ValueError, match=r"does not fit the actor: lstm\.rnn\.bias_hh_l0 is \(64,\)"):
        PPORunner(FakeEnv(), cfg).load(tmp_path)
