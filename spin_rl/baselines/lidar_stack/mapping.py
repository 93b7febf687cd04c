"""The mapping drive: to the goal and back by what the lidar shows, with noisy odometry and scan matching.

It stands for the minutes in which somebody drives the robot through the place by hand (SPIN, Classical), and
for gmapping with its scan matcher and one particle. No physics takes part: the robot goes where the drive
leads it, step by step; what it knows of it is what its odometry and its scans tell.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import warp as wp

from spin_rl.baselines.lidar_stack.grids import Grids, Ways, on_host
from spin_rl.baselines.lidar_stack.poses import compose, into_frame, to_frame_of, wrap
from spin_rl.baselines.lidar_stack.scans import LidarModel, front_first
from spin_rl.baselines.lidar_stack.settings import MapSettings
from spin_rl.sensors.odometry import OdometryConfig
from spin_rl.warp_kernels.distance_field.field import UNREACHABLE
from spin_rl.warp_kernels.grid_map.matching import climb_poses
from spin_rl.warp_kernels.grid_map.scans import HIT

_LOOK_M = 0.3
"""How far along its way the drive looks for its direction."""


class Scans(Protocol):
    """What takes scans, such as `sensors.lidar.Survey`."""

    def scan(self, moved: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Ranges (n, rays) [m] at poses in the frame of the start (n, 3), where a mask (n,) says so."""
        ...


def with_errors(
    motion: np.ndarray, odometry: OdometryConfig, rng: np.random.Generator, shape: tuple[int, ...] = ()
) -> np.ndarray:
    """Draw what motions may have been that odometry tells of, or what it tells of motions.

    Args:
        motion: In the frame of their beginning (x [m], y [m], yaw [rad]), shape (n, 3).
        odometry: Errors.
        rng: Random numbers.
        shape: Shape of the draws for each motion, such as (particles,).

    Returns:
        Motions, shape (n, *shape, 3).
    """
    turn_by_turn, way_by_turn, turn_by_way, way_by_way = odometry.variances()
    turned, way = np.abs(motion[:, 2]), np.hypot(motion[:, 0], motion[:, 1])
    turn_error = np.sqrt(turn_by_turn * turned + turn_by_way * way)
    way_error = np.sqrt(way_by_turn * turned + way_by_way * way)
    expand = (slice(None), *[None] * len(shape))
    drawn = rng.standard_normal((2, len(motion), *shape))
    turn = turn_error[expand] * drawn[0]
    further = way_error[expand] * drawn[1]
    direction = np.where(way > 1e-6, np.arctan2(motion[:, 1], motion[:, 0]), 0.5 * motion[:, 2])
    heading = direction[expand] + 0.5 * turn
    length = way[expand] + further
    return np.stack(
        (length * np.cos(heading), length * np.sin(heading), motion[:, 2][expand] + turn), axis=-1
    )


class MappingDrive:
    """Drives through all worlds at once and fills their grids."""

    def __init__(
        self, grids: Grids, ways: Ways, lidar: LidarModel, cfg: MapSettings, odometry: OdometryConfig
    ) -> None:
        """Take over what it fills and uses."""
        self._grids, self._ways, self._lidar = grids, ways, lidar
        self._cfg, self._odometry = cfg, odometry

    def run(
        self, worlds: np.ndarray, survey: Scans, goal: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        """Map some worlds from the start of the episode, which is the origin of the map.

        Args:
            worlds: A mask, shape (n,).
            survey: Takes scans.
            goal: In the frame of the start [m], shape (n, 2).
            rng: Random numbers.

        Returns:
            How far the map's idea of the last pose was from the truth [m], shape (n,).
        """
        cfg, n = self._cfg, len(goal)
        true, believed = np.zeros((n, 3)), np.zeros((n, 3))
        target = goal.copy()
        homeward = np.zeros(n, dtype=bool)
        left = worlds.copy()
        self._grids.restart(worlds, goal)
        for index in range(cfg.most_scans):
            if not left.any():
                break
            believed = self._take_in(left, survey.scan(true, left), believed, match=index > 0)
            arrived = left & (np.hypot(*(target - believed[:, :2]).T) < cfg.arrived_m)
            if index % cfg.scans_between_plans == 0 or arrived.any():
                self._turn_round(left, arrived, homeward, target)
                due = left if index % cfg.scans_between_plans == 0 else left & arrived
                self._ways.plan(due, target)
            motion, way = self._next_motion(left, believed)
            # Where nothing leads there any more, it goes home; where nothing leads home, the drive is over.
            self._turn_round(left, left & (way >= UNREACHABLE), homeward, target)
            motion[~left] = 0.0
            true = compose(true, motion)
            believed = compose(believed, with_errors(motion, self._odometry, rng))
        return np.hypot(*(true - believed)[:, :2].T)

    @staticmethod
    def _turn_round(left: np.ndarray, arrived: np.ndarray, homeward: np.ndarray, target: np.ndarray) -> None:
        left &= ~(arrived & homeward)
        homeward |= arrived
        target[arrived] = 0.0

    def _take_in(
        self, worlds: np.ndarray, ranges: np.ndarray, believed: np.ndarray, *, match: bool
    ) -> np.ndarray:
        """Match a scan, from where the odometry puts the robot, and add it to the map; return where it is."""
        cfg, lidar, grids = self._cfg, self._lidar, self._grids
        ends, kinds = lidar.limited(ranges, lidar.far_m, lidar.far_m)
        pose = believed
        if match:
            points, counts = front_first(ends, kinds == int(HIT))
            poses, scores = on_host(believed, wp.vec3), on_host(np.zeros(len(believed)), float)
            climb_poses(
                on_host(worlds, wp.bool),
                grids.near,
                grids.frame,
                on_host(points, wp.vec2),
                on_host(counts, wp.int32),
                stride=max(len(lidar.angles) // cfg.match_beams, 1),
                step_m=cfg.match_step_m,
                step_rad=cfg.match_step_rad,
                halvings=cfg.match_halvings,
                poses_out=poses,
                score_out=scores,
            )
            pose = poses.numpy().astype(np.float64)
        start = to_frame_of(pose, np.broadcast_to(lidar.position, (len(pose), 2)))
        grids.add_to_map(worlds, start, to_frame_of(pose[:, None, :], ends), kinds)
        return pose

    def _next_motion(self, worlds: np.ndarray, believed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A turn towards the way and a piece along it, in the robot's frame; and the length of the way."""
        cfg = self._cfg
        point, way = self._ways.lookahead(worlds, believed, _LOOK_M)
        ahead = into_frame(believed, point)
        aside = wrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
        turn = np.clip(aside, -cfg.turn_rad, cfg.turn_rad)
        length = np.minimum(np.hypot(ahead[:, 0], ahead[:, 1]), cfg.way_m)
        length = np.where(np.abs(aside) > cfg.turn_rad, 0.0, length)
        return np.stack((length * np.cos(turn), length * np.sin(turn), turn), axis=1), way
