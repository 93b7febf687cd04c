"""Environments that a collecting process makes, good ones and others."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import torch
from distill_worlds import DepthEnv, make_student_config

from spin_rl.runners.remote.runner import AsyncDistillRunner, RemoteEnv


def make_env(
    num_envs: int = 4, delay_s: float = 0.0, fails_at: int | None = None, dies_at: int | None = None
):
    """An environment that may be slow, fail or die at a step."""
    torch.set_num_threads(1)
    env = DepthEnv(num_envs=num_envs)
    step, count = env.step, [0]

    def wrapped(actions):
        count[0] += 1
        if count[0] == fails_at:
            raise ArithmeticError("the world ended")
        if count[0] == dies_at:
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(delay_s)
        return step(actions)

    env.step = wrapped
    return env


def make_recording_env():
    """An environment whose state tells all actions that it has taken, shape (steps, num_envs, actions)."""
    env = make_env()
    step, state_dict, history = env.step, env.state_dict, []

    def recorded(actions):
        history.append(actions.clone())
        return step(actions)

    env.step = recorded
    env.state_dict = lambda: state_dict() | {"history": torch.stack(history) if history else None}
    return env


def fail_to_make_env():
    raise OSError("there is no world")


def train_for_ever(teacher: Path, run_dir: Path) -> None:
    """Train until killed; write down the collector's number."""
    torch.set_num_threads(1)
    env = RemoteEnv(make_env, "cpu")
    runner = AsyncDistillRunner(env, make_student_config(teacher), run_dir)
    (run_dir / "collector").write_text(str(env.pid))
    runner.train(1_000_000)
