"""A field of ways: how long the way to the goal is from anywhere, and where it leads.

The same as `warp_kernels.distance_field` reads them: `field`, `trace` and `subgoal` there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

UNREACHABLE = 1.0e4
"""Value of cells from which no way leads to the goal [m]."""
_CORNERS = np.array([[0, 0], [1, 0], [0, 1], [1, 1]])
_AROUND = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])


@dataclass(frozen=True)
class Field:
    """Values on a grid; the outermost cells are a frame without.

    Attributes:
        values: Length of the way from every cell [m], shape (rows, columns).
        origin: Lower corner of the grid [m], shape (2,); rows go along y.
        cell: Side of a cell [m].
        goal: Where the ways end [m], shape (2,).
    """

    values: np.ndarray
    origin: np.ndarray
    cell: float
    goal: np.ndarray

    def at(self, points: np.ndarray) -> np.ndarray:
        """Return the ways from points [m], shape (n, 2) -> (n,); `UNREACHABLE` and more where there is none.

        Interpolated is what the way is longer than the straight line, by the cells that a way leads from.
        """
        rows, columns = self.values.shape
        offset = np.clip((points - self.origin) / self.cell - 1.5, 0.0, (columns - 3.0, rows - 3.0))
        first = np.minimum(offset.astype(int), (columns - 4, rows - 4))
        beyond = (offset - first)[:, None]
        weights = np.where(_CORNERS, beyond, 1.0 - beyond).prod(-1)
        cells = first[:, None] + 1 + _CORNERS
        values = self.values[cells[..., 1], cells[..., 0]]
        weights *= values < UNREACHABLE
        total = weights.sum(-1)
        to_goal = self.origin + self.cell * (cells + 0.5) - self.goal
        detours = values - np.hypot(to_goal[..., 0], to_goal[..., 1])
        detour = np.where(total > 1e-6, (weights * detours).sum(-1) / np.maximum(total, 1e-6), UNREACHABLE)
        return np.hypot(*(points - self.goal).T) + detour

    def downhill(self, points: np.ndarray) -> np.ndarray:
        """Return the directions of steepest descent at points [m], shape (n, 2), unit vectors."""
        around = points[:, None] + 0.5 * self.cell * _AROUND[1:]
        return _descent(self.at(around.reshape(-1, 2)).reshape(-1, 4))

    def ahead(self, point: np.ndarray, length: float) -> np.ndarray:
        """Return the point of the way from a point that is some length ahead [m], shape (2,).

        It is the goal where that is nearer, or where no way is known.
        """
        at = point
        value, slope = self._look(at)
        if value >= UNREACHABLE:
            return self.goal
        steps = int(length / self.cell)
        for left in reversed(range(steps)):
            straight = math.hypot(*(at - self.goal))
            in_sight = straight <= left * self.cell and value <= straight + 0.1 * self.cell
            if straight <= self.cell or in_sight:
                return self.goal
            to = at + self.cell * slope
            lower, slope = self._look(to)
            if lower > value - 0.5 * self.cell:  # over a ridge, or along a wall's cells
                to = self._lowest_near(at)
                lower, slope = self._look(to)
            if lower >= value:
                break
            at, value = to, lower
        return at

    def _look(self, point: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the way from a point [m] and the direction of steepest descent there."""
        around = self.at(point + 0.5 * self.cell * _AROUND)
        return float(around[0]), _descent(around[None, 1:])[0]

    def _lowest_near(self, point: np.ndarray) -> np.ndarray:
        """Return the centre of the lowest of the 9 cells around a point [m]."""
        rows, columns = self.values.shape
        column, row = np.clip(((point - self.origin) / self.cell).astype(int), 1, (columns - 2, rows - 2))
        near = self.values[row - 1 : row + 2, column - 1 : column + 2]
        j, i = divmod(int(near.argmin()), 3)
        if near[j, i] >= UNREACHABLE:
            i = j = 1
        return self.origin + self.cell * np.array([column + i - 0.5, row + j - 0.5])


def _descent(around: np.ndarray) -> np.ndarray:
    """Return unit vectors downhill, shape (n, 2), of values right, left, above and below, shape (n, 4)."""
    slope = around[:, [0, 2]] - around[:, [1, 3]]
    return -slope / np.maximum(np.linalg.norm(slope, axis=-1, keepdims=True), 1e-12)
