"""What the benchmarks of the navigation task share: running drives under several conditions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np
import torch

from spin_rl.benchmark.metrics import DriveEpisodes
from spin_rl.benchmark.rounds import Report, describe_task, run_rounds
from spin_rl.policy import Policy
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.env import NavEnv


def run_drives(
    env: NavEnv,
    policy: Policy,
    conditions: int,
    episodes: int,
    prepare: Callable[[np.ndarray], None],
    *,
    report: Report = print,
) -> list[DriveEpisodes]:
    """Run exactly `episodes` episodes under every condition, see `rounds.run_rounds`.

    Args:
        env: Environment with any number of worlds.
        policy: Policy for it.
        conditions: How many there are.
        episodes: Episodes per condition.
        prepare: Gives every world the condition of an array of shape (num_envs,).
        report: Receives lines of progress.

    Returns:
        Episodes of every condition.
    """
    # Conditions alternate, so that every round has about the same mix of short and long episodes.
    queue = np.tile(np.arange(conditions), episodes)
    everything = run_rounds(
        env, policy, queue, prepare, lambda: drive_figures(env), DriveEpisodes, report=report
    )
    return [everything.select(queue == c) for c in range(conditions)]


def drive_figures(env: NavEnv) -> dict[str, torch.Tensor]:
    """What `DriveEpisodes` have beside outcome and steps, of the step just made."""
    assert env.last_transition is not None
    return {
        "distance": env.last_transition.goal_distance,
        "parts": env.sim.views.part_contacts,
        "way": env.final_way,
        "driven": env.final_driven,
    }


def describe_drives(cfg: NavConfig) -> dict[str, Any]:
    """What the result of a benchmark of the navigation task tells of the task."""
    return {
        "goal_tolerance_m": cfg.goal_tolerance_m,
        "scandots": asdict(cfg.scandots),
        "noise": asdict(cfg.noise),
        **describe_task(cfg),
    }
