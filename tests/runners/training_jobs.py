"""Training processes that tests start, stop and kill."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import torch
from distill_worlds import DepthEnv, make_student_config
from fake_env import FakeEnv, make_config

from spin_rl.runners import PPORunner
from spin_rl.runners.distillation.runner import DistillRunner


def train_with_a_save_each_iteration(run_dir: Path) -> None:
    """Train for ever; wide layers make a save take long enough to be hit by a kill."""
    torch.set_num_threads(1)
    cfg = make_config(num_learning_epochs=1) | {"save_interval": 1}
    cfg["critic"] = cfg["critic"] | {"hidden_dims": [512, 512]}
    PPORunner(FakeEnv(num_envs=4), cfg, run_dir).train(1_000_000)


def train_until_signalled(run_dir: Path) -> None:
    """Train without saves on the way."""
    torch.set_num_threads(1)
    PPORunner(FakeEnv(), make_config() | {"save_interval": 1_000_000}, run_dir).train(1_000_000)


def join_group(rank: int, world_size: int, port: int) -> None:
    """Be a process that torchrun started."""
    ranks = {"RANK": rank, "LOCAL_RANK": rank, "WORLD_SIZE": world_size, "MASTER_PORT": port}
    os.environ.update({name: str(value) for name, value in ranks.items()} | {"MASTER_ADDR": "127.0.0.1"})
    torch.set_num_threads(1)


def distill_in_parallel(rank: int, world_size: int, port: int, teacher: Path, run_dir: Path) -> None:
    """Distil in one of several replicas and store its student."""
    join_group(rank, world_size, port)
    runner = DistillRunner(DepthEnv(seed=rank), make_student_config(teacher), run_dir)
    runner.train(4)
    torch.save(runner.alg.student.state_dict(), run_dir / f"{rank}.pt")
    runner.close()


def train_in_parallel(rank: int, world_size: int, port: int, run_dir: Path) -> None:
    """Train one of several replicas and store what each of them ends with."""
    join_group(rank, world_size, port)
    runner = PPORunner(FakeEnv(seed=rank), make_config() | {"save_interval": 2}, run_dir)
    summary = runner.train(3)
    models = {"actor": runner.alg.actor.state_dict(), "critic": runner.alg.critic.state_dict()}
    torch.save(
        models | {"summary": summary, "learning_rate": runner.alg.learning_rate}, run_dir / f"{rank}.pt"
    )
    runner.close()


class HangingEnv(FakeEnv):
    """An environment that gets stuck in a step."""

    run_dir: Path

    def step(self, actions: torch.Tensor):
        (self.run_dir / "hanging").touch()
        while True:
            time.sleep(0.05)


def train_and_hang(run_dir: Path) -> None:
    """Never finish an iteration."""
    env = HangingEnv()
    env.run_dir = run_dir
    PPORunner(env, make_config(), run_dir).train(1)


def train_under_a_launcher(run_dir: Path) -> None:
    """Train for ever as one of torchrun's workers, and leave a file with the process's number."""
    torch.set_num_threads(1)
    (run_dir / f"pid_{os.getpid()}").touch()
    runner = PPORunner(FakeEnv(seed=int(os.environ["RANK"])), make_config(), run_dir)
    runner.train(1_000_000)
    runner.close()


if __name__ == "__main__":
    train_under_a_launcher(Path(sys.argv[1]))
