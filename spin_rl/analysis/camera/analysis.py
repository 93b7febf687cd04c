"""What a policy's camera motion is worth: the same places with its own, a frozen, and a useless camera."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from spin_rl.analysis.camera.sampled import SampledCamera, check_draws
from spin_rl.analysis.camera.variants import SAMPLED, Variant, check_pose
from spin_rl.analysis.camera.watch import Motion, WatchedPolicy
from spin_rl.analysis.hits import Hit, summarize_hits
from spin_rl.analysis.watch import SETTLING_S
from spin_rl.benchmark.metrics import Episodes, ReachEpisodes, paired_difference, summarize
from spin_rl.benchmark.reach import REACH_CELLS, Cell, run_cells
from spin_rl.benchmark.rooms import families_of, run_families
from spin_rl.benchmark.rounds import SEED_OFFSET, Report, check_counts, one_batch
from spin_rl.config import ConfigError
from spin_rl.policy import Policy, PolicyFactory
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.env import NavEnv


@dataclass(frozen=True)
class Conditions:
    """The conditions of a benchmark.

    Attributes:
        benchmark: Its name.
        rows: What names each of them in a row of results.
        run: Runs a number of episodes of each: environment, policy, number, and by keyword `report`.
    """

    benchmark: str
    rows: tuple[dict[str, Any], ...]
    run: Callable[..., Sequence[ReachEpisodes]]


def corridors(cells: Sequence[Cell] = REACH_CELLS) -> Conditions:
    """Cells of the reach benchmark."""
    rows = tuple({"scenario": cell.scenario, "difficulty": cell.difficulty} for cell in cells)
    return Conditions(
        "reach",
        rows,
        lambda env, policy, episodes, report: run_cells(env, policy, cells, episodes, report=report),
    )


def places(cfg: NavConfig) -> Conditions:
    """The families of the rooms benchmark that have a share in a configuration's scene.

    Raises:
        ConfigError: The scenes are not of families.
    """
    families = families_of(cfg)
    return Conditions(
        "rooms",
        tuple({"family": family} for family in families),
        lambda env, policy, episodes, report: run_families(env, policy, families, episodes, report=report),
    )


@dataclass
class Measured:
    """What a variant's episodes gave.

    Attributes:
        variant: The variant.
        cells: Episodes of every condition, in the same order of places for all variants.
        motion: How the camera moved, None where no episode was long enough.
        hits: All collisions.
    """

    variant: Variant
    cells: list[ReachEpisodes]
    motion: Motion | None
    hits: list[Hit]


def analyse_camera(
    make_policy: PolicyFactory,
    cfg: NavConfig,
    episodes: int,
    seeds: Sequence[int],
    device: str,
    *,
    further: Sequence[Variant],
    conditions: Conditions | None = None,
    policy_name: str = "policy",
    num_envs: int | None = None,
    announce: Callable[[str], contextlib.AbstractContextManager[Any]] | None = None,
    report: Callable[[str], None] = print,
) -> dict[str, Any]:
    """Run a policy with its own camera, with the camera held at its own mean pose, and in further ways.

    Places, start poses and goals are the same for all variants, and so are the camera's start pose and the
    pose that it is held at. All episodes of a seed run at once, since only first episodes can be paired.

    Args:
        make_policy: Makes the policy once observations exist.
        cfg: Task configuration; its scenario and difficulty are set per world.
        episodes: Episodes per condition and seed.
        seeds: Seeds of places, start poses and goals, all different.
        device: "cpu" or "cuda:N".
        further: Variants beside these two.
        conditions: Of the benchmark; None takes all corridors.
        policy_name: For the result.
        num_envs: Most worlds at once; must hold all episodes of a seed.
        announce: Context manager factory around work that may compile kernels.
        report: Receives lines of progress.

    Returns:
        `policy`, `benchmark`, `analysis` ("camera"), `cells` (names of the conditions), `variants` (see
        `describe`; first the own camera, then the one frozen at its mean pose), and the settings of the
        measurement.

    Raises:
        ConfigError: No episodes, no seeds, the same seed twice, too few worlds, a pose beyond the limits, or
            actions of the camera that should be drawn of a policy without a distribution, or are of no
            effect.
        ValueError: No episode was long enough to tell the camera's mean pose.
    """
    check_counts(episodes, seeds, num_envs)
    conditions = conditions or corridors()
    nworld = one_batch(len(conditions.rows) * episodes, num_envs)
    for variant in further:
        check_pose(variant)
    is_sampled = any(variant.kind == SAMPLED for variant in further)
    if is_sampled and cfg.camera_pose is not None:
        raise ConfigError("camera_analysis.sampled: task.camera_pose holds the camera, drawn or not")
    start = time.monotonic()
    total = 2 + len(further)
    # One for all variants: a training that goes on may replace the file meanwhile.
    policy: Policy | None = None

    def measure(number: int, variant: Variant) -> Measured:
        nonlocal policy
        task = cfg if variant.pose is None else replace(cfg, camera_pose=variant.pose)
        starting = f"Variant {number} of {total}, {variant.name}: starting {nworld} worlds on {device}"
        if announce and number == 1:
            with announce(starting):
                env = NavEnv(task, nworld, device)
        else:
            report(starting)
            env = NavEnv(task, nworld, device)
        if policy is None:
            policy = make_policy(env.get_observations(), device)
            if is_sampled:
                check_draws(policy)
        acting = SampledCamera(policy, env.camera_actions) if variant.kind == SAMPLED else policy
        return run_variant(acting, env, variant, conditions, episodes, seeds, report)

    own = measure(1, Variant("own camera", "own"))
    measured = [own]
    for number, variant in enumerate([frozen_at_mean(own), *further], start=2):
        measured.append(measure(number, variant))
    return {
        "policy": policy_name,
        "benchmark": conditions.benchmark,
        "analysis": "camera",
        "cells": list(conditions.rows),
        "variants": [describe(result, own, conditions.rows, cfg.sim.control_period) for result in measured],
        "seeds": list(seeds),
        "episodes_per_seed": episodes,
        "num_envs": nworld,
        "device": device,
        "robot": cfg.robot_profile,
        "camera_mount": cfg.camera_mount,
        "episode_s": cfg.episode_s,
        "depth": None if cfg.depth is None else asdict(cfg.depth),
        "seconds": round(time.monotonic() - start, 2),
    }


def run_variant(
    policy: Policy,
    env: NavEnv,
    variant: Variant,
    conditions: Conditions,
    episodes: int,
    seeds: Sequence[int],
    report: Report,
) -> Measured:
    """Run one variant in an environment with one world per episode of a seed.

    Args:
        policy: The policy.
        env: Environment whose camera is as the variant says.
        variant: The variant.
        conditions: Of the benchmark.
        episodes: Episodes per cell and seed.
        seeds: Seeds.
        report: Receives lines of progress.
    """
    watched = WatchedPolicy(policy, env)
    per_seed = []
    for seed in seeds:
        env.reseed(SEED_OFFSET + seed)
        per_seed.append(
            conditions.run(
                env, watched, episodes, report=lambda line, seed=seed: report(f"  seed {seed}: {line}")
            )
        )
    joined = [Episodes.concatenate(list(groups)) for groups in zip(*per_seed, strict=True)]
    return Measured(variant, joined, watched.motion(), watched.hits)


def frozen_at_mean(own: Measured) -> Variant:
    """The freeze test: the camera held at the mean pose of what was measured with the policy's own.

    Raises:
        ValueError: No episode was long enough to tell.
    """
    if own.motion is None:
        raise ValueError(f"no episode outlasted {SETTLING_S} s, so the camera has no mean pose")
    pose = (own.motion.pan.mean, own.motion.tilt.mean)
    return Variant("frozen at own mean", "frozen", pose)


def describe(
    result: Measured, own: Measured, conditions: Sequence[dict[str, Any]], control_period: float
) -> dict[str, Any]:
    """Turn a variant's measurement into the entry of the result.

    Returns:
        `name`, `kind`, `camera_pose` (None for the policy's own), `rows` as in the benchmark's result,
        `mean_success` over them, `difference` (None for the first variant, see `paired_difference`),
        `camera` (`pan` and `tilt`, see `CameraMotion`, or None) and `hits` (see `summarize_hits`). For the
        policy's own camera also `looking`, with `share` (see `share_of_time`) and `examples`.
    """
    rows = [
        condition | summarize(group, control_period)
        for condition, group in zip(conditions, result.cells, strict=True)
    ]
    pose, motion = result.variant.pose, result.motion
    looking = {}
    if motion is not None and result.variant.kind == "own":
        looking = {"looking": {"share": motion.share, "examples": motion.examples}}
    return {
        "name": result.variant.name,
        "kind": result.variant.kind,
        "camera_pose": None if pose is None else list(pose),
        "rows": rows,
        "mean_success": sum(row["success_rate"] for row in rows) / len(rows),
        "difference": None if result is own else paired_difference(own.cells, result.cells),
        "camera": motion and {"pan": asdict(motion.pan), "tilt": asdict(motion.tilt)},
        "hits": summarize_hits(result.hits),
        **looking,
    }
