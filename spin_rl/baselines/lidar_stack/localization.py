"""Monte Carlo localization of all worlds (Thrun, Burgard and Fox 2005, chapter 8), as AMCL has it."""

from __future__ import annotations

import numpy as np
import warp as wp

from spin_rl.baselines.lidar_stack.grids import Grids, on_host
from spin_rl.baselines.lidar_stack.mapping import with_errors
from spin_rl.baselines.lidar_stack.poses import compose, relative, wrap
from spin_rl.baselines.lidar_stack.settings import LocalizationSettings
from spin_rl.sensors.odometry import OdometryConfig
from spin_rl.warp_kernels.grid_map.matching import score_poses


class ParticleFilter:
    """Particles of all worlds, weighed by the likelihood field of their maps.

    Attributes:
        poses: Of the particles in the map (x [m], y [m], yaw [rad]), shape (n, particles, 3).
        weights: Of the particles, sum 1 a world, shape (n, particles).
    """

    def __init__(self, grids: Grids, cfg: LocalizationSettings, rng: np.random.Generator) -> None:
        """Allocate for the grids, whose `near` is the likelihood field."""
        n = grids.shape[0]
        self._grids, self._cfg, self._rng = grids, cfg, rng
        self._odometry = OdometryConfig(*cfg.alphas)
        self.poses = np.zeros((n, cfg.particles, 3))
        self.weights = np.full((n, cfg.particles), 1.0 / cfg.particles)
        self._at = np.zeros((n, 3))  # of the odometry, at the last update
        self._updates = np.zeros(n, dtype=np.int64)
        self._map_from_odometry = np.zeros((n, 3))

    def restart(self, worlds: np.ndarray) -> None:
        """Start some worlds, a mask, at a guess of where the map has its origin."""
        cfg, count = self._cfg, int(worlds.sum())
        spread = np.array([cfg.start_error_m, cfg.start_error_m, cfg.start_error_rad])
        guess = spread * self._rng.standard_normal((count, 1, 3))
        drawn = spread * self._rng.standard_normal((count, cfg.particles, 3))
        self.poses[worlds] = guess + drawn
        self.weights[worlds] = 1.0 / cfg.particles
        self._at[worlds] = 0.0
        self._updates[worlds] = 0
        self._map_from_odometry[worlds] = guess[:, 0]

    def pose(self, odometry: np.ndarray) -> np.ndarray:
        """Where the robots are in the map, by what their odometry says, shape (n, 3)."""
        return compose(self._map_from_odometry, odometry)

    def update(
        self, worlds: np.ndarray, odometry: np.ndarray, points: np.ndarray, counts: np.ndarray
    ) -> None:
        """Move and weigh the particles of those worlds that have moved enough, or have just begun.

        Args:
            worlds: Worlds that may be updated, a mask, shape (n,).
            odometry: Poses, shape (n, 3).
            points: Hits of the last scan in the base frame [m], shape (n, beams, 2).
            counts: How many of them count, shape (n,).
        """
        cfg = self._cfg
        motion = relative(self._at, odometry)
        motion[:, 2] = wrap(motion[:, 2])
        moved = np.hypot(motion[:, 0], motion[:, 1]) >= cfg.update_m
        moved |= np.abs(motion[:, 2]) >= cfg.update_rad
        due = worlds & (moved | (self._updates < cfg.first_updates)) & (counts > 0)
        if not due.any():
            return
        drawn = with_errors(motion[due], self._odometry, self._rng, (cfg.particles,))
        self.poses[due] = compose(self.poses[due], drawn)
        self._at[due] = odometry[due]
        self._updates[due] += 1
        self._weigh(due, points, counts)
        resampled = due & (self._updates % cfg.resample_interval == 0)
        for world in np.flatnonzero(resampled):
            self._resample(int(world))
        self._map_from_odometry[due] = _frame(self._mean(due), odometry[due])

    def _weigh(self, due: np.ndarray, points: np.ndarray, counts: np.ndarray) -> None:
        """Multiply the weights by the likelihood of the scan."""
        cfg, grids = self._cfg, self._grids
        scores = on_host(np.zeros(self.weights.shape), float)
        stride = max(points.shape[1] // cfg.beams, 1)
        score_poses(
            on_host(due, wp.bool),
            grids.near,
            grids.frame,
            on_host(self.poses, wp.vec3),
            on_host(points, wp.vec2),
            on_host(counts, wp.int32),
            stride=stride,
            score_out=scores,
        )
        fit = cfg.independence * scores.numpy()[due].astype(np.float64)
        likelihood = np.exp(fit - fit.max(axis=1, keepdims=True))
        weights = self.weights[due] * likelihood
        self.weights[due] = weights / weights.sum(axis=1, keepdims=True)

    def _resample(self, world: int) -> None:
        """Draw the particles of a world anew, with one random number (low variance)."""
        count = self.weights.shape[1]
        at = (np.arange(count) + self._rng.random()) / count
        chosen = np.searchsorted(np.cumsum(self.weights[world]), at)
        self.poses[world] = self.poses[world, np.minimum(chosen, count - 1)]
        self.weights[world] = 1.0 / count

    def _mean(self, due: np.ndarray) -> np.ndarray:
        weights, poses = self.weights[due], self.poses[due]
        xy = (weights[..., None] * poses[..., :2]).sum(axis=1)
        yaw = np.arctan2((weights * np.sin(poses[..., 2])).sum(1), (weights * np.cos(poses[..., 2])).sum(1))
        return np.concatenate((xy, yaw[:, None]), axis=1)


def _frame(pose: np.ndarray, odometry: np.ndarray) -> np.ndarray:
    """The odometry's frame in the map, in which `odometry` is at `pose`."""
    yaw = pose[:, 2] - odometry[:, 2]
    origin = np.concatenate((np.zeros_like(pose[:, :2]), yaw[:, None]), axis=1)
    turned = compose(origin, odometry)
    return np.concatenate((pose[:, :2] - turned[:, :2], yaw[:, None]), axis=1)
