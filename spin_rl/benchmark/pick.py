"""The pick benchmark: tables with each of the five objects in equal numbers (SPIN, Table 1)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import torch

from spin_rl.benchmark.metrics import Episodes, PickEpisodes, summarize_picks
from spin_rl.benchmark.rounds import Announce, WatchPolicy, check_counts, describe_task, run_rounds, run_seeds
from spin_rl.policy import Policy, PolicyFactory
from spin_rl.scenes.objects.shapes import OBJECTS
from spin_rl.tasks.common.objects.config import ANY_OBJECT, object_names
from spin_rl.tasks.pick.config import PickConfig
from spin_rl.tasks.pick.env import PickEnv


def evaluate_pick(
    make_policy: PolicyFactory,
    cfg: PickConfig,
    episodes: int,
    seeds: Sequence[int],
    device: str,
    *,
    policy_name: str = "policy",
    num_envs: int | None = None,
    announce: Announce | None = None,
    report: Callable[[str], None] = print,
    watch: WatchPolicy | None = None,
) -> dict[str, Any]:
    """Run the benchmark.

    Every seed is a batch of its own: its tables depend on the seed and the number of worlds only. An episode
    ends with its first success.

    Args:
        make_policy: Makes the policy once observations exist.
        cfg: Task configuration; one object alone if it names one.
        episodes: Episodes of all objects together, per seed.
        seeds: Seeds of tables, objects and start poses, all different.
        device: "cpu" or "cuda:N".
        policy_name: For the result.
        num_envs: Most worlds at once; None takes all episodes at once as far as that is sensible.
        announce: Context manager factory around work that may compile kernels.
        report: Receives lines of progress.
        watch: Looks on, see `rounds.run_seeds`.

    Returns:
        `policy`, `benchmark`, `overall` and `rows` (see `metrics.summarize_picks`; of each object, named by
        `object`), and the settings under which they were measured.

    Raises:
        ConfigError: No episodes, no seeds, the same seed twice, or no worlds.
    """
    check_counts(episodes, seeds, num_envs)
    kinds = (OBJECTS if cfg.object == ANY_OBJECT else object_names(cfg.object))[:episodes]
    groups, facts = run_seeds(
        lambda nworld: PickEnv(cfg, nworld, device),
        make_policy,
        lambda env, policy, report: run_objects(env, policy, kinds, episodes, report=report),
        episodes,
        seeds,
        device,
        num_envs=num_envs,
        announce=announce,
        report=report,
        watch=watch,
    )
    period = cfg.sim.control_period
    return {
        "policy": policy_name,
        "benchmark": "pick",
        "overall": summarize_picks(Episodes.concatenate(groups), period),
        "rows": [
            {"object": kind} | summarize_picks(group, period)
            for kind, group in zip(kinds, groups, strict=True)
        ],
        "episodes_per_seed": episodes,
        **{key: getattr(cfg, key) for key in ("lift_m", "hold_s", "grasp_force_n", "hard_force_n", "fall_m")},
        "detector": cfg.detector,
        "sight": asdict(cfg.sight),
        "noise": asdict(cfg.noise),
        **describe_task(cfg),
        **facts,
    }


def run_objects(
    env: PickEnv,
    policy: Policy,
    kinds: Sequence[str],
    episodes: int,
    *,
    report: Callable[[str], None] = print,
) -> list[PickEpisodes]:
    """Run exactly `episodes` episodes, in turn with every object; see `rounds.run_rounds`.

    Args:
        env: Environment with any number of worlds.
        policy: Policy for it.
        kinds: Names of `objects.OBJECTS`.
        episodes: Episodes of all objects together.
        report: Receives lines of progress.

    Returns:
        Episodes of every object, in the order of `kinds`.
    """

    def measure() -> dict[str, torch.Tensor]:
        assert env.last_transition is not None
        step = env.last_transition
        return {"distance": step.distance, "hard_peak": step.hard_peak}

    queue = np.arange(episodes) % len(kinds)
    everything = run_rounds(
        env,
        policy,
        queue,
        lambda chosen: env.set_objects([kinds[int(c)] for c in chosen]),
        measure,
        PickEpisodes,
        report=report,
    )
    return [everything.select(queue == c) for c in range(len(kinds))]
