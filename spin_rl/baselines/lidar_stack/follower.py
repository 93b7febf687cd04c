# pyright: reportGeneralTypeIssues=false
# (to a type checker, a Warp struct is an object, not a class)
"""The follower: the speeds of the best short drive, in every control step anew (dynamic window)."""

from __future__ import annotations

import numpy as np
import warp as wp

from spin_rl.baselines.lidar_stack.grids import on_host
from spin_rl.baselines.lidar_stack.settings import FollowerSettings
from spin_rl.robot import SpeedProfile
from spin_rl.warp_kernels.distance_field.field import Field
from spin_rl.warp_kernels.grid_map.rollouts import IMPOSSIBLE, Footprint, Weights, weigh_drives

_WINDOW_S = 0.3
"""So long speeds may rise for, from what they are, to be tried."""


class Follower:
    """Weighs drives of all worlds.

    Attributes:
        reach_m: Farther points of a scan do not matter.
    """

    def __init__(self, cfg: FollowerSettings, profile: SpeedProfile) -> None:
        """Lay out the speeds to try."""
        self._cfg, self._profile = cfg, profile
        self._speed = min(cfg.speed, profile.forward_max)
        turns = min(cfg.turn, profile.turn_max) * np.linspace(-1.0, 1.0, cfg.turns)
        forward = [(share * self._speed, turn) for share in cfg.speeds for turn in turns]
        backward = [(-min(cfg.reverse, profile.reverse_max), turn) for turn in turns[:: cfg.turns // 4]]
        self._drives = np.array(forward + backward)
        idle = (self._drives[:, 0] < 0.0) | ~self._drives.any(axis=1)
        self._idle_cost = cfg.idle_m * idle
        self._footprint, self._weights = Footprint(), Weights()
        low_x, low_y, high_x, high_y = cfg.footprint
        self._footprint.low, self._footprint.high = wp.vec2(low_x, low_y), wp.vec2(high_x, high_y)
        weights = self._weights
        weights.time, weights.steps, weights.ahead = cfg.time_s, cfg.steps, cfg.ahead_m
        weights.margin, weights.near, weights.obstacle = cfg.margin_m, cfg.near_m, cfg.obstacle_m
        longest = float(np.hypot(max(high_x, -low_x), max(high_y, -low_y)))
        self.reach_m = self._speed * cfg.time_s + longest + cfg.near_m

    def choose(
        self,
        poses: np.ndarray,
        field: Field,
        points: np.ndarray,
        counts: np.ndarray,
        speeds: np.ndarray,
        escaping: np.ndarray,
    ) -> np.ndarray:
        """Choose the best drive of every world.

        Args:
            poses: In the map, shape (n, 3).
            field: Ways left.
            points: Hits of the last scan in the base frame [m], shape (n, beams, 2).
            counts: How many of them count, shape (n,).
            speeds: Forward [m/s] and turning [rad/s] speeds now, shape (n, 2).

            escaping: Where to drive to the freest place instead of nearer to the goal, a mask, shape (n,).

        Returns:
            Speeds, shape (n, 2), 0 where no drive is possible.
        """
        cost, gap = self._weigh(poses, field, points, counts, self._drives)
        rated = np.where(escaping[:, None], 1e-3 * cost - gap, cost + self._idle_cost)
        cost = np.where(cost < float(IMPOSSIBLE), rated, cost)
        rise = self._profile.base_acceleration * _WINDOW_S
        too_fast = self._drives[None, :, 0] > np.maximum(speeds[:, :1], 0.0) + rise
        cost = np.where(too_fast, float(IMPOSSIBLE), cost)
        best = cost.argmin(axis=1)
        possible = cost[np.arange(len(cost)), best] < float(IMPOSSIBLE)
        return np.where(possible[:, None], self._drives[best], 0.0)

    def is_clear(
        self, poses: np.ndarray, field: Field, points: np.ndarray, counts: np.ndarray, speeds: np.ndarray
    ) -> np.ndarray:
        """Whether one given drive of every world touches nothing, shape (n,)."""
        cost, _ = self._weigh(poses, field, points, counts, speeds[:, None, :])
        return cost[:, 0] < float(IMPOSSIBLE)

    def _weigh(
        self, poses: np.ndarray, field: Field, points: np.ndarray, counts: np.ndarray, drives: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        n = len(poses)
        tried = np.broadcast_to(drives, (n, *drives.shape[-2:]))
        shape = tried.shape[:2]
        cost, gap = (wp.zeros(shape, dtype=float, device=field.values.device) for _ in range(2))
        weigh_drives(
            on_host(poses, wp.vec3),
            field,
            on_host(points, wp.vec2),
            on_host(counts, wp.int32),
            on_host(tried, wp.vec2),
            self._footprint,
            self._weights,
            cost_out=cost,
            gap_out=gap,
        )
        return cost.numpy(), gap.numpy()
