"""Does a camera have to look around in these scenes? Constant head poses against one that moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from spin_rl import robot
from spin_rl.analysis.episodes import run_watched
from spin_rl.analysis.sight import judge
from spin_rl.analysis.sight.driver import MapDriver, SeesAll
from spin_rl.analysis.sight.fetches import FetchWatch, fetch_groups
from spin_rl.analysis.sight.heads import Poses
from spin_rl.analysis.sight.options import MAP, SightOptions
from spin_rl.analysis.sight.record import SightWatch
from spin_rl.benchmark.metrics import Episodes, paired_difference, wilson_interval
from spin_rl.benchmark.registry import Benchmark
from spin_rl.benchmark.rounds import Announce, Report
from spin_rl.policy import Policy, PolicyFactory
from spin_rl.tasks.common import episode


def analyse_sight(
    benchmark: Benchmark,
    make_policy: PolicyFactory,
    cfg: Any,
    options: SightOptions,
    episodes: int,
    seeds: Sequence[int],
    device: str,
    *,
    policy_name: str,
    pick_name: str | None = None,
    num_envs: int | None = None,
    announce: Announce | None = None,
    report: Report = print,
) -> dict[str, Any]:
    """Run a benchmark's episodes once and tell which cameras would have seen in time what was in the way.

    An obstacle is decisive if the robot, going on at its speeds of some moment, would have come nearer to it
    than `near_m` within `lead_s`. It counted when that was so for the first time, or before that, as long as
    braking would have helped. It was seen if one of its corners had been shown by then, with nothing of scene
    and robot in between, and is still known. In a fetch the object counts too, see `fetches.object_events`.

    Args:
        benchmark: One of the navigation task, or the fetch.
        make_policy: Makes the policy that drives; not used where `policy_name` is `MAP`.
        cfg: Task configuration; `MapDriver` drives through what it touches.
        options: Head poses and criterion.
        episodes: Episodes per condition (cell, family) and seed.
        seeds: Seeds, all different.
        device: "cpu" or "cuda:N".
        policy_name: Whose driving it was.
        pick_name: Whose picking, in a fetch.
        num_envs: Most worlds at once; must hold all episodes of a seed.
        announce: Context manager factory around work that may compile kernels.
        report: Receives lines of progress.

    Returns:
        The benchmark's result; with `analysis` ("sight"), `groups` (see `describe`, one for each family of
        places, one for all corridors, or those of `fetches.fetch_groups`), and the settings of the
        measurement.

    Raises:
        ConfigError: Too few worlds, head poses beyond their limits, or whatever the benchmark refuses.
    """
    poses = Poses(options.pans, options.tilts)
    is_map = policy_name == MAP
    if is_map:
        cfg = replace(cfg, stop_on_collision=False, sim=replace(cfg.sim, kinematic=True))
    settings: dict[str, Any] = {"lead_s": options.lead_s, "near_m": options.near_m}

    def watch(policy: Policy, env: Any, _seed: int) -> Any:
        if pick_name is not None:  # told of all obstacles, policies that learned to see them fetch nothing
            return FetchWatch(policy, env, poses, **settings)
        driver = MapDriver(env, options.speed_m_s) if is_map else SeesAll(policy)
        return SightWatch(driver, env, poses, **settings)

    watches: list[Any]
    result, watches, names = run_watched(
        watch,
        benchmark,
        make_policy,
        cfg,
        episodes,
        seeds,
        device,
        policy_name=policy_name,
        pick_name=pick_name,
        num_envs=num_envs,
        announce=announce,
        report=report,
    )
    for watched in watches:
        watched.finish()
    period = cfg.sim.control_period
    if pick_name is None:
        groups = _groups_of_drives(result, names, watches, len(poses), options, period)
    else:
        groups = fetch_groups(watches, len(poses), options, period)
    travel = np.ceil(poses.travel_s(robot.SPEED_PROFILES[cfg.robot_profile]) / period - 1e-9).astype(int)
    return result | {
        "analysis": "sight",
        "sight": asdict(options),
        "groups": [
            {"name": name} | describe(events, poses, travel, period) for name, events in groups.items()
        ],
    }


def _groups_of_drives(
    result: dict[str, Any],
    names: list[str],
    watches: list[SightWatch],
    num_poses: int,
    options: SightOptions,
    period: float,
) -> dict[str, judge.Events]:
    """Events of each family of places, or of all corridors."""
    parts = [
        judge.find_events(record, num_poses, options, period)
        for watched in watches
        for record in watched.records
    ]
    events = judge.join(parts)
    if result["benchmark"] != "rooms":
        return {"corridors": events}
    # Conditions take turns over the worlds of a batch, and every seed is one.
    worlds = np.arange(events.worlds) % (result["episodes_per_seed"] * len(names)) % len(names)
    return {name: judge.of_worlds(events, np.flatnonzero(worlds == i)) for i, name in enumerate(names)}


def describe(events: judge.Events, poses: Poses, travel: np.ndarray, period: float) -> dict[str, Any]:
    """Compare cameras in a group of episodes.

    Args:
        events: The decisive obstacles.
        poses: Head poses.
        travel: Control steps that the head takes between them, shape (npose, npose), int.
        period: Time between two observations [s].

    Returns:
        `episodes`, `decisive` (obstacles per episode) and `none` (share of the episodes without any).
        `unseen`: share of the episodes in which a decisive obstacle was unseen when it counted, of every
        constant pose, in rows of pans. `cameras`: the best constant pose (`held`), `to and fro`, `looks
        around` and `all around`, the first two with their `poses` [rad], each with `unseen`, `ci95` (Wilson)
        and, but for the first, `difference` of the share that was seen to the best constant pose
        (`metrics.paired_difference`).
    """
    failed = events.failed(judge.held(events))
    shares = failed.mean(axis=0)
    best = int(shares.argmin())
    swing, pair = judge.to_and_fro(events, travel, period)
    cameras = {
        "held": (failed[:, best], [best]),
        "to and fro": (events.failed(swing), list(pair)),
        "looks around": (events.failed(judge.look_around(events, travel, best)), []),
        "all around": (events.failed(judge.anywhere(events)), []),
    }
    own = _as_episodes(failed[:, best])
    return {
        "episodes": events.worlds,
        "decisive": len(events.world) / events.worlds,
        "none": 1.0 - len(np.unique(events.world)) / events.worlds,
        "unseen": np.round(shares.reshape(len(poses.pans), -1), 4).tolist(),
        "cameras": [
            {
                "name": name,
                "poses": [poses.table[pose].tolist() for pose in at],
                "unseen": float(lost.mean()),
                "ci95": list(wilson_interval(int(lost.sum()), len(lost))),
                "difference": None if name == "held" else paired_difference([own], [_as_episodes(lost)]),
            }
            for name, (lost, at) in cameras.items()
        ],
    }


def _as_episodes(failed: np.ndarray) -> Episodes:
    """Episodes that succeeded where everything decisive was seen in time."""
    outcome = np.where(failed, episode.COLLISION, episode.SUCCESS)
    return Episodes(outcome, np.zeros_like(outcome))
