"""What the benchmarks share: every world's first episode after a common start, seed by seed."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any, TypeVar

import numpy as np
import torch

from spin_rl.benchmark.metrics import Episodes
from spin_rl.config import ConfigError
from spin_rl.machine import commit
from spin_rl.policy import Policy, PolicyFactory, make_in
from spin_rl.tasks.common.config import TaskConfig
from spin_rl.tasks.common.env import TaskEnv

# Worlds in one batch: a CPU core has no use for more, and a GPU is full.
_MAX_WORLDS = {"cpu": 600, "cuda": 16384}
# Reading the flags waits for the device.
_STEPS_BETWEEN_CHECKS = 5
_SECONDS_BETWEEN_REPORTS = 5.0
# Far from any seed that a training takes, so that its first scenes are not those of the benchmark.
SEED_OFFSET = 1_000_000

Env = TypeVar("Env", bound=TaskEnv)
Kind = TypeVar("Kind", bound=Episodes)
Report = Callable[[str], None]
Announce = Callable[[str], contextlib.AbstractContextManager[Any]]
RunSeed = Callable[[Env, Policy, Report], list[Kind]]
"""Runs a seed's episodes; returns those of every condition."""
WatchPolicy = Callable[[Any, Policy, int], Policy]
"""Puts something that looks on around a policy in an environment for a seed."""


def run_seeds(
    make_env: Callable[[int], Env],
    make_policy: PolicyFactory,
    run_seed: RunSeed[Env, Kind],
    total: int,
    seeds: Sequence[int],
    device: str,
    *,
    num_envs: int | None = None,
    announce: Announce | None = None,
    report: Report = print,
    watch: WatchPolicy | None = None,
) -> tuple[list[Kind], dict[str, Any]]:
    """Run a benchmark's episodes; every seed is a batch of its own.

    Args:
        make_env: Makes the environment with a number of worlds.
        make_policy: Makes the policy once observations exist.
        run_seed: Runs the episodes of one seed in the environment, which has been given the seed.
        total: Episodes of one seed.
        seeds: Seeds, see `check_counts`.
        device: "cpu" or "cuda:N".
        num_envs: Most worlds at once; None takes all episodes at once as far as that is sensible.
        announce: Context manager factory around work that may compile kernels.
        report: Receives lines of progress.
        watch: Looks on; then all episodes of a seed run at once, so that a world stands for an episode.

    Returns:
        The episodes of every condition, those of all seeds together; and what every benchmark's result tells
        of the measurement: task, seeds, worlds, device, overflows, commit, seconds. After Ctrl-C they are of
        the seeds that were finished, and it tells of that too (`stopped`).

    Raises:
        KeyboardInterrupt: It came before a seed was finished.
        ConfigError: Too few worlds for one that looks on.
    """
    start = time.monotonic()
    nworld = batch_size(total, num_envs, device) if watch is None else one_batch(total, num_envs)
    with announce(f"Starting {nworld} worlds on {device}") if announce else contextlib.nullcontext():
        env = make_env(nworld)
    policy = make_in(env, make_policy)
    env.health.clear()
    per_seed = []
    stopped = False
    for seed in seeds:
        env.reseed(SEED_OFFSET + seed)
        watched = policy if watch is None else watch(env, policy, seed)
        try:
            per_seed.append(run_seed(env, watched, lambda line, seed=seed: report(f"  seed {seed}: {line}")))
        except KeyboardInterrupt:
            if not per_seed or watch is not None:  # what one looking on has seen cannot be undone
                raise
            stopped = True
            report(f"  seed {seed}: interrupted; what follows is of the seeds before it")
            break
    groups = [Episodes.concatenate(list(group)) for group in zip(*per_seed, strict=True)]
    return groups, {
        "seeds": list(seeds)[: len(per_seed)],
        **({"stopped": True} if stopped else {}),
        "num_envs": nworld,
        "device": device,
        "overflows": {name: count for name, count in env.health.read().items() if count},
        "commit": commit(),
        "seconds": round(time.monotonic() - start, 2),
    }


def describe_task(cfg: TaskConfig) -> dict[str, Any]:
    """What every benchmark's result tells of the task that it was measured in."""
    return {
        "robot": cfg.robot_profile,
        "camera_mount": cfg.camera_mount,
        "camera_pose": None if cfg.camera_pose is None else list(cfg.camera_pose),
        "episode_s": cfg.episode_s,
        "sim": asdict(cfg.sim),
        "depth": None if cfg.depth is None else asdict(cfg.depth),
    }


def check_counts(episodes: int, seeds: Sequence[int], num_envs: int | None) -> None:
    """Reject numbers of episodes and worlds, and seeds, that no benchmark can run.

    Raises:
        ConfigError: No episodes, no seeds, the same seed twice, or no worlds.
    """
    if episodes < 1:
        raise ConfigError(f"episodes: at least 1 is needed, got {episodes}")
    if not seeds:
        raise ConfigError("seeds: at least one is needed, such as seeds=[0]")
    if len(set(seeds)) < len(seeds):
        raise ConfigError(f"seeds: every seed may appear once, got {list(seeds)}")
    if num_envs is not None and num_envs < 1:
        raise ConfigError(f"num_envs: at least 1 is needed, got {num_envs}")


def batch_size(episodes: int, num_envs: int | None, device: str) -> int:
    """Number of worlds that spreads episodes evenly over the fewest rounds.

    Args:
        episodes: Episodes of all conditions together.
        num_envs: Most worlds at once, or None for the device's limit.
        device: "cpu" or "cuda:N".
    """
    limit = num_envs or _MAX_WORLDS[torch.device(device).type]
    rounds = math.ceil(episodes / limit)
    return math.ceil(episodes / rounds)


def one_batch(episodes: int, num_envs: int | None) -> int:
    """Number of worlds that runs all episodes of a seed at once.

    Args:
        episodes: Episodes of all conditions together.
        num_envs: Most worlds at once, or None.

    Raises:
        ConfigError: Too few worlds.
    """
    if num_envs is not None and num_envs < episodes:
        raise ConfigError(
            f"num_envs: all {episodes} episodes of a seed must run at once; use fewer episodes and more seeds"
        )
    return episodes


def run_rounds(
    env: TaskEnv,
    policy: Policy,
    queue: np.ndarray,
    prepare: Callable[[np.ndarray], None],
    measure: Callable[[], Mapping[str, torch.Tensor]],
    kind: type[Kind],
    *,
    report: Report = print,
) -> Kind:
    """Run one episode for every entry of a queue of conditions.

    In each round every world is given a condition, starts anew, and contributes the first episode after that
    start, however long it takes: taking whatever ends first would prefer short episodes.

    Args:
        env: Environment with any number of worlds.
        policy: Policy for it.
        queue: Condition of every episode, shape (n,), int.
        prepare: Gives every world the condition of an array of shape (num_envs,).
        measure: Returns what `kind` has beside outcome and steps, of the step just made, of shape (num_envs,
            ...) each; kept of the step that ended the episode.
        kind: What to return.
        report: Receives lines of progress.
    """
    finished: list[Kind] = []
    progress = _Progress(len(queue), report)
    for first in range(0, len(queue), env.num_envs):
        assigned = queue[first : first + env.num_envs]
        # The last round may have fewer episodes than worlds; what the others do is not looked at.
        prepare(np.resize(assigned, env.num_envs))
        # A world's scene must not depend on how often it started anew before, which is up to the policy.
        env.set_episode(len(finished))
        finished.append(kind(**_run_round(env, policy, len(assigned), measure, progress)))
    return Episodes.concatenate(finished)


class _Progress:
    """Prints how many episodes are done, now and then."""

    def __init__(self, total: int, report: Report) -> None:
        self._total = total
        self._report = report
        self._before = 0
        self._start = self._last = time.monotonic()

    def show(self, in_round: int) -> None:
        """Tell about the episodes of the running round."""
        now = time.monotonic()
        if now - self._last >= _SECONDS_BETWEEN_REPORTS:
            self._last = now
            self._line(self._before + in_round)

    def add_round(self, count: int) -> None:
        """Count a finished round."""
        self._before += count
        if self._before == self._total:
            self._line(self._before)

    def _line(self, done: int) -> None:
        self._report(f"{done} of {self._total} episodes after {time.monotonic() - self._start:.0f} s")


@torch.no_grad()
def _run_round(
    env: TaskEnv,
    policy: Policy,
    count: int,
    measure: Callable[[], Mapping[str, torch.Tensor]],
    progress: _Progress,
) -> dict[str, np.ndarray]:
    """Run the first episode of worlds 0 to `count` - 1 to its end."""
    obs = env.reset()
    policy.reset()
    running = torch.arange(env.num_envs, device=env.device) < count
    kept: dict[str, torch.Tensor] = {}
    for step in range(1, env.max_episode_length + 1):
        obs, _, done, _ = env.step(policy(obs))
        policy.reset(done)
        ended = running & (done > 0)
        steps = torch.full_like(env.outcome, step)
        for name, value in ({"outcome": env.outcome, "steps": steps} | dict(measure())).items():
            rows = ended.view(-1, *[1] * (value.ndim - 1))
            kept[name] = torch.where(rows, value, kept.get(name, torch.zeros_like(value)))
        running = running & ~ended
        if step % _STEPS_BETWEEN_CHECKS == 0:
            left = int(running.sum())
            if left == 0:
                break
            progress.show(count - left)
    if bool(running.any()):
        raise RuntimeError("an episode went on beyond the time limit")
    progress.add_round(count)
    return {name: value[:count].cpu().numpy() for name, value in kept.items()}
