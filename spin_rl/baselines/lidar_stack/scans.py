"""Beams of a lidar: from ranges to points, and the last turn of a mirror on a robot that drives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spin_rl.baselines.lidar_stack.poses import into_frame, to_frame_of
from spin_rl.warp_kernels.grid_map.scans import HIT, PASSED, SKIPPED

_SPACING_M = 0.028
"""Of rays that are left out beside others."""
_UNSEEN_M = 0.25
"""A ray that does not come back may still hit what it hit so near before: the lidar sees from 0.15 m on."""


@dataclass(frozen=True)
class LidarModel:
    """What a stack knows of its lidar.

    Attributes:
        angles: Directions of the rays in the base frame [rad], shape (rays,).
        position: In the base frame [m], shape (2,).
        far_m: Farthest range [m].
    """

    angles: np.ndarray
    position: np.ndarray
    far_m: float

    def points(self, ranges: np.ndarray) -> np.ndarray:
        """Ends of beams of some lengths [m] in the base frame, (n, rays) -> (n, rays, 2)."""
        directions = np.stack((np.cos(self.angles), np.sin(self.angles)), axis=-1)
        return self.position + ranges[..., None] * directions

    def kinds(self, ranges: np.ndarray) -> np.ndarray:
        """What beams say, `HIT` or `SKIPPED`, (n, rays) -> (n, rays), int32.

        One that does not come back says nothing: what it met may be too far away, or too near.
        """
        return np.where(ranges > 0.0, np.int32(HIT), np.int32(SKIPPED))

    def limited(self, ranges: np.ndarray, mark_m: float, clear_m: float) -> tuple[np.ndarray, np.ndarray]:
        """Ends in the base frame and kinds of beams that mark and clear only so far [m]."""
        kinds = self.kinds(ranges)
        kinds[ranges > mark_m] = int(PASSED)
        return self.points(np.clip(ranges, 0.0, clear_m)), kinds


class LastTurn:
    """The newest measurement of every ray, kept in the frame of the odometry, so that driving bends nothing.

    Attributes:
        complete: Whether every ray has been measured since the start, shape (n,), bool.
    """

    def __init__(self, model: LidarModel, nworld: int) -> None:
        """Allocate for a number of worlds."""
        self._model = model
        shape = (nworld, len(model.angles))
        self._ends = np.zeros((*shape, 2))
        self._kinds = np.full(shape, int(SKIPPED), dtype=np.int32)
        self._seen = np.zeros(shape, dtype=bool)

    @property
    def complete(self) -> np.ndarray:
        """Which worlds' rays have all been measured."""
        return np.asarray(self._seen.all(axis=1))

    def restart(self, worlds: np.ndarray) -> None:
        """Forget what was measured in some worlds, a mask of shape (n,)."""
        self._kinds[worlds] = int(SKIPPED)
        self._seen[worlds] = False

    def add(self, ranges: np.ndarray, odometry: np.ndarray) -> None:
        """Take in what a control step has brought; what has come too near to be seen stays.

        Args:
            ranges: Of the rays, below 0 where the mirror has not been [m], shape (n, rays).
            odometry: Poses at which they were measured, shape (n, 3).
        """
        away = np.hypot(
            *np.moveaxis(into_frame(odometry[:, None, :], self._ends) - self._model.position, -1, 0)
        )
        stays = (ranges == 0.0) & (self._kinds == int(HIT)) & (away < _UNSEEN_M)
        new = (ranges >= 0.0) & ~stays
        ends = to_frame_of(odometry[:, None, :], self._model.points(ranges))
        self._ends[new] = ends[new]
        self._kinds[new] = self._model.kinds(ranges)[new]
        self._seen |= ranges >= 0.0

    def hits(
        self, odometry: np.ndarray, within_m: float, *, thinned: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        """Where obstacles are around the robots now.

        Args:
            odometry: Poses now, shape (n, 3).
            within_m: Farther ones are left out [m].
            thinned: Leave out rays that are close beside others, within 3 cm.

        Returns:
            Points in the base frame, those that count first in every row, shape (n, rays, 2); and how many
            count, shape (n,).
        """
        points = into_frame(odometry[:, None, :], self._ends)
        away = (points**2).sum(axis=-1)
        counted = (self._kinds == int(HIT)) & (away < within_m**2)
        if thinned:
            ray, turn = np.arange(points.shape[1]), 2.0 * np.pi / points.shape[1]
            for every in (2, 4):
                counted &= (ray % every == 0) | (away > (_SPACING_M / (every * turn)) ** 2)
        return front_first(points, counted)


def front_first(points: np.ndarray, counted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bring the points that count to the front of their rows; also return how many there are."""
    order = np.argsort(~counted, axis=1, kind="stable")
    return np.take_along_axis(points, order[..., None], axis=1), counted.sum(axis=1)
