"""Two CPU replicas stay one model."""

import socket

import torch
import training_jobs
from distill_worlds import DepthEnv
from fake_env import make_config
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from spin_rl.runners import PPORunner, load_checkpoint, load_policy


def free_port() -> int:
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        return server.getsockname()[1]


def run_two(processes, target, *arguments):
    """Run a job in two processes of a group."""
    port = free_port()
    jobs = [processes.Process(target=target, args=(rank, 2, port, *arguments)) for rank in (0, 1)]
    for job in jobs:
        job.start()
    for job in jobs:
        job.join(60.0)
    assert [job.exitcode for job in jobs] == [0, 0]


def test_students_stay_equal_through_both_phases(tmp_path, processes):
    teacher = tmp_path / "teacher"
    PPORunner(DepthEnv(), make_config(), teacher).train(1)
    run_two(processes, training_jobs.distill_in_parallel, teacher, tmp_path)
    first, second = (torch.load(tmp_path / f"{rank}.pt") for rank in (0, 1))
    start = load_policy(teacher).state_dict()
    assert all(torch.equal(value, second[name]) for name, value in first.items())
    assert not torch.equal(first["lstm.rnn.weight_hh_l0"], start["lstm.rnn.weight_hh_l0"])


def test_replicas_stay_equal_and_one_of_them_writes(tmp_path, processes):
    run_two(processes, training_jobs.train_in_parallel, tmp_path)
    first, second = (torch.load(tmp_path / f"{rank}.pt") for rank in (0, 1))
    for model in ("actor", "critic"):
        for name in first[model]:
            assert torch.equal(first[model][name], second[model][name]), f"{model}.{name}"
    assert first["learning_rate"] == second["learning_rate"]
    # The normalizer has seen the samples of both.
    assert first["actor"]["obs_normalizer.count"] == 3 * 8 * 12 * 2

    for key in ("success_rate", "mean_return", "env_steps", "stopped_by"):
        assert first["summary"][key] == second["summary"][key]
    assert first["summary"]["env_steps"] == 3 * 8 * 12 * 2
    assert len(list(tmp_path.glob("events.*"))) == 1
    assert EventAccumulator(str(tmp_path)).Reload().Scalars("Perf/env_steps")[-1].value == 3 * 8 * 12 * 2

    state = load_checkpoint(tmp_path / "checkpoints" / "last.pt")
    positions = [process["env"]["position"] for process in state["processes"]]
    assert len(positions) == 2 and not torch.equal(*positions)  # each one's own environments
