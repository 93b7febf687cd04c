"""Why episodes of the reach benchmark fail: the benchmark again, with a look at every failure."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, fields
from typing import Any

import numpy as np

from spin_rl.analysis.camera.analysis import check_one_batch
from spin_rl.analysis.failures.watch import Failure, FailureWatch
from spin_rl.benchmark.metrics import Episodes, summarize
from spin_rl.benchmark.reach import REACH_CELLS, run_cells
from spin_rl.benchmark.rounds import SEED_OFFSET
from spin_rl.machine import commit
from spin_rl.policy import PolicyFactory
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.env import NavEnv


def analyse_failures(
    make_policy: PolicyFactory,
    cfg: NavConfig,
    episodes: int,
    seeds: Sequence[int],
    device: str,
    *,
    policy_name: str = "policy",
    overrides: Sequence[str] = (),
    num_envs: int | None = None,
    announce: Callable[[str], contextlib.AbstractContextManager[Any]] | None = None,
    report: Callable[[str], None] = print,
) -> dict[str, Any]:
    """Run the reach benchmark and look at every failure.

    All episodes of a seed run at once, so that seed and world say which corridor it was. The corridors are
    those of the benchmark if that, too, runs all episodes of a seed at once.

    Args:
        make_policy: Makes the policy once observations exist.
        cfg: Task configuration; its scenario and difficulty are set per world.
        episodes: Episodes per cell and seed.
        seeds: Seeds of corridors, start poses and goals, all different.
        device: "cpu" or "cuda:N".
        policy_name: For the result.
        overrides: Settings of the task that a replay needs as well, for the result.
        num_envs: Most worlds at once; must hold all episodes of a seed.
        announce: Context manager factory around work that may compile kernels.
        report: Receives lines of progress.

    Returns:
        `policy`, `benchmark` ("reach"), `analysis` ("failures"), `rows` as in `reach.evaluate_reach`,
        `failures` (see `Failure`; with `play`, the overrides of spin-play that show it), `durations_s` of all
        episodes, and the settings of the measurement.

    Raises:
        ConfigError: No episodes, no seeds, the same seed twice, or too few worlds.
    """
    nworld = len(REACH_CELLS) * episodes
    check_one_batch(episodes, seeds, nworld, num_envs)
    start = time.monotonic()
    with announce(f"Starting {nworld} worlds on {device}") if announce else contextlib.nullcontext():
        env = NavEnv(cfg, nworld, device)
    policy = make_policy(env.get_observations(), device)
    per_seed, failures = [], []
    for seed in seeds:
        env.reseed(SEED_OFFSET + seed)
        watch = FailureWatch(policy, env, seed)
        per_seed.append(
            run_cells(
                env,
                watch,
                REACH_CELLS,
                episodes,
                report=lambda line, seed=seed: report(f"  seed {seed}: {line}"),
            )
        )
        failures += watch.failures
    groups = [Episodes.concatenate(list(cell)) for cell in zip(*per_seed, strict=True)]
    period = cfg.sim.control_period
    return {
        "policy": policy_name,
        "benchmark": "reach",
        "analysis": "failures",
        "rows": [
            asdict(cell) | summarize(group, period) for cell, group in zip(REACH_CELLS, groups, strict=True)
        ],
        "failures": [asdict(failure) | {"play": replay(failure, overrides)} for failure in failures],
        "durations_s": np.round(np.concatenate([group.steps for group in groups]) * period, 3).tolist(),
        "seeds": list(seeds),
        "episodes_per_seed": episodes,
        "num_envs": nworld,
        "device": device,
        "robot": cfg.robot_profile,
        "camera_mount": cfg.camera_mount,
        "episode_s": cfg.episode_s,
        "depth": None if cfg.depth is None else asdict(cfg.depth),
        "commit": commit(),
        "seconds": round(time.monotonic() - start, 2),
    }


def replay(failure: Failure, overrides: Sequence[str] = ()) -> str:
    """Return the overrides of spin-play, beside the policy, that play a failure's corridor again."""
    keys = [f"{key}={getattr(failure, key)}" for key in ("scenario", "difficulty", "seed", "world")]
    return " ".join([*keys, *overrides])


def failures_of(result: dict[str, Any]) -> list[Failure]:
    """Read the failures of a result, such as one from a file."""
    names = [field.name for field in fields(Failure)]
    return [Failure(**{name: entry[name] for name in names}) for entry in result["failures"]]
