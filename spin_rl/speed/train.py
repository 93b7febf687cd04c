"""Speed of training: environment, inference and update, in one process and in several."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import torch

from spin_rl.runners.ppo.runner import PPORunner
from spin_rl.speed.env import RandomDriver
from spin_rl.speed.peers.rsl_rl import RslRlPeer
from spin_rl.speed.rows import Row, rate_row
from spin_rl.speed.timing import Stopwatch, Timing
from spin_rl.tasks.nav.env import NavEnv

MIN_BLOCKS = 3
WARM_UP_ITERATIONS = 2
_UNIT = "env steps/s"


class Learner:
    """Trains in an environment: rollouts under the policy that learns, and updates.

    Attributes:
        alg: The algorithm.
    """

    def __init__(self, env: NavEnv, cfg: dict[str, Any]) -> None:
        """Make models and algorithm by the section `runner` of a configuration."""
        self._env = env
        self._num_steps = cfg["num_steps_per_env"]
        self.alg = PPORunner(env, cfg, None, env.device).alg
        self.alg.train_mode()

    @torch.no_grad()
    def roll_out(self) -> None:
        """Collect one rollout."""
        obs = self._env.get_observations()
        for _ in range(self._num_steps):
            obs, rewards, dones, extras = self._env.step(self.alg.act(obs))
            self.alg.process_env_step(obs, rewards, dones, extras)
        self.alg.compute_returns(obs)

    def iterate(self) -> None:
        """Collect one rollout and learn from it."""
        self.roll_out()
        self.alg.update()


def measure_train(
    driver: RandomDriver, cfg: dict[str, Any], seconds: float, watch: Stopwatch
) -> tuple[list[Row], Timing]:
    """Time whole training iterations part by part, beside the bare environment and rsl_rl's update.

    A block is one rollout of the environment under random actions, one under the policy that learns, one
    update, and one update of the peer on a rollout of the same shape.

    Args:
        driver: Drives the environment to train in.
        cfg: Section `runner` of the configuration.
        seconds: Time to measure for; at least `MIN_BLOCKS` blocks are measured.
        watch: Waits for the device.

    Returns:
        Rows, and the timing of full training per environment step.
    """
    env = driver.env
    learner = Learner(env, cfg)
    alg, num_steps = learner.alg, cfg["num_steps_per_env"]
    learner.roll_out()
    peer = RslRlPeer(alg, cfg["obs_groups"], cfg)
    alg.update()
    peer.update()
    parts: dict[str, list[float]] = {name: [] for name in ("env", "rollout", "update", "peer")}
    start = time.monotonic()
    while len(parts["env"]) < MIN_BLOCKS or time.monotonic() - start < seconds:
        parts["env"].append(watch.time(driver.step, num_steps))
        parts["rollout"].append(watch.time(learner.roll_out))
        parts["update"].append(watch.time(alg.update))
        parts["peer"].append(watch.time(peer.update))
    steps = num_steps * env.num_envs

    def timing(*names: str) -> Timing:
        return Timing(tuple(sum(times) / steps for times in zip(*(parts[n] for n in names), strict=True)))

    stepping, full = timing("env"), timing("rollout", "update")
    rows = [
        rate_row("train: env step", stepping, _UNIT),
        rate_row(
            "train: env step + inference", timing("rollout"), _UNIT, "env step, random actions", stepping
        ),
        rate_row("train: full training, 1 process", full, _UNIT, "env step, random actions", stepping),
        rate_row(
            "train: update alone", timing("update"), _UNIT, _peer_name(alg.actor, alg.critic), timing("peer")
        ),
    ]
    return rows, full


def measure_processes(
    processes: int, overrides: list[str], device: str, iterations: int, single: Timing
) -> Row:
    """Time `spin-train` under torchrun.

    Args:
        processes: Number of processes, each with its own worlds.
        overrides: Command-line overrides of the training.
        device: "cpu" or "cuda".
        iterations: Iterations to measure.
        single: Full training in one process, the baseline; of the same run but not of the same blocks.

    Raises:
        RuntimeError: The training fails; the message ends with its last lines.
    """
    with tempfile.TemporaryDirectory(prefix="spin-bench-") as folder:
        run_dir = Path(folder) / "run"
        limits = [f"max_iterations={WARM_UP_ITERATIONS + iterations}", "max_minutes=null"]
        limits += [f"run_dir={run_dir}", f"device={device}"]
        command = [sys.executable, "-m", "torch.distributed.run", "--standalone"]
        command += [f"--nproc-per-node={processes}", "-m", "spin_rl.cli.train", *overrides, *limits]
        environment = os.environ | {"OMP_NUM_THREADS": os.environ.get("OMP_NUM_THREADS", "1")}
        done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
        if done.returncode:
            raise RuntimeError(f"Training in {processes} processes failed: {done.stderr.strip()[-2000:]}")
        timing = Timing(tuple(1.0 / rate for rate in iteration_rates(run_dir)))
    spread = (1.0 / max(timing.blocks), 1.0 / min(timing.blocks))
    return Row(
        f"train: full training, {processes} processes",
        1.0 / timing.median,
        _UNIT,
        "full training, 1 process",
        single.median / timing.median,
        spread,
        1.0 / single.median,
    )


def iteration_rates(run_dir: Path) -> list[float]:
    """Environment steps per second of every iteration of a run after the first ones, which warm up."""
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(run_dir)).Reload()
    rates = [event.value for event in events.Scalars("Perf/total_fps")]
    return rates[WARM_UP_ITERATIONS:]


def _peer_name(actor: Any, critic: Any) -> str:
    kinds = [f"LSTM-{m.rnn_hidden_dim}" if m.is_recurrent else "MLP" for m in (actor, critic)]
    return f"rsl_rl PPO, flat observations, {kinds[0]} actor and {kinds[1]} critic"
