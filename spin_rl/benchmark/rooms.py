"""The rooms benchmark: every family of places that the scene's parameters give a share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from spin_rl.benchmark.drives import describe_drives, run_drives
from spin_rl.benchmark.metrics import DriveEpisodes, summarize_drives
from spin_rl.benchmark.rounds import Announce, Report, WatchPolicy, check_counts, run_seeds
from spin_rl.config import ConfigError
from spin_rl.policy import Policy, PolicyFactory
from spin_rl.scenes.kinds import FAMILIES
from spin_rl.scenes.rooms.params import FamilyParams
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.env import NavEnv


def evaluate_rooms(
    make_policy: PolicyFactory,
    cfg: NavConfig,
    episodes: int,
    seeds: Sequence[int],
    device: str,
    *,
    policy_name: str = "policy",
    num_envs: int | None = None,
    announce: Announce | None = None,
    report: Report = print,
    watch: WatchPolicy | None = None,
) -> dict[str, Any]:
    """Run the benchmark.

    Every seed is a batch of its own: its scenes depend on the seed and the number of worlds only.

    Args:
        make_policy: Makes the policy once observations exist.
        cfg: Task configuration with `FamilyParams`; families with a share are measured, the size of the share
            does not matter.
        episodes: Episodes per family and seed.
        seeds: Seeds of scenes, all different.
        device: "cpu" or "cuda:N".
        policy_name: For the result.
        num_envs: Most worlds at once; None takes all episodes at once as far as that is sensible.
        announce: Context manager factory around work that may compile kernels.
        report: Receives lines of progress.
        watch: Looks on, see `rounds.run_seeds`.

    Returns:
        `policy`, `benchmark`, `rows` (see `metrics.summarize_drives`, with `family`), and the settings under
        which the rows were measured.

    Raises:
        ConfigError: The scenes are not of families; no episodes, no seeds, the same seed twice, or no worlds.
    """
    check_counts(episodes, seeds, num_envs)
    families = families_of(cfg)
    groups, facts = run_seeds(
        lambda nworld: NavEnv(cfg, nworld, device),
        make_policy,
        lambda env, policy, report: run_families(env, policy, families, episodes, report=report),
        len(families) * episodes,
        seeds,
        device,
        num_envs=num_envs,
        announce=announce,
        report=report,
        watch=watch,
    )
    return {
        "policy": policy_name,
        "benchmark": "rooms",
        "rows": [
            {"family": family} | summarize_drives(group, cfg.sim.control_period)
            for family, group in zip(families, groups, strict=True)
        ],
        "episodes_per_seed": episodes,
        "slack_s": cfg.slack_s,
        "slowness": cfg.slowness,
        **describe_drives(cfg),
        **facts,
    }


def families_of(cfg: NavConfig) -> list[str]:
    """Names of the families that have a share in the scenes of a configuration.

    Raises:
        ConfigError: The scenes are not of families.
    """
    if not isinstance(cfg.scene, FamilyParams):
        raise ConfigError(f"scene: benchmark=rooms needs scene=mixture or one of {', '.join(FAMILIES)}")
    return [family for family in FAMILIES if getattr(cfg.scene.shares, family) > 0.0]


def run_families(
    env: NavEnv, policy: Policy, families: Sequence[str], episodes: int, *, report: Report = print
) -> list[DriveEpisodes]:
    """Run exactly `episodes` episodes in scenes of every family, see `rounds.run_rounds`."""
    numbers = np.array([FAMILIES.index(family) for family in families])
    return run_drives(
        env,
        policy,
        len(families),
        episodes,
        lambda chosen: env.set_families(numbers[chosen].tolist()),
        report=report,
    )
