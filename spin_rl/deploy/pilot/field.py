"""A field of ways: how long the way to the goal is from anywhere, and where it leads.

The same as `warp_kernels.distance_field` reads them: `field`, `trace` and `subgoal` there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

UNREACHABLE = 1.0e4
"""Value of cells from which no way leads to the goal [m]."""


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
        last = np.array([columns - 3.0, rows - 3.0])
        offset = np.clip((points - self.origin) / self.cell - 1.5, 0.0, last)
        first = np.minimum(offset.astype(int), last.astype(int) - 1)
        across, up = (offset - first).T
        detour, weights = np.zeros(len(points)), np.zeros(len(points))
        for i, j in ((0, 0), (1, 0), (0, 1), (1, 1)):
            cell = first + (1 + i, 1 + j)
            value = self.values[cell[:, 1], cell[:, 0]]
            weight = np.where(i, across, 1.0 - across) * np.where(j, up, 1.0 - up) * (value < UNREACHABLE)
            straight = np.hypot(*(self.origin + self.cell * (cell + 0.5) - self.goal).T)
            detour += weight * (value - straight)
            weights += weight
        is_reached = weights > 1e-6
        detour = np.where(is_reached, detour / np.where(is_reached, weights, 1.0), UNREACHABLE)
        return np.hypot(*(points - self.goal).T) + detour

    def downhill(self, points: np.ndarray) -> np.ndarray:
        """Return the directions of steepest descent at points [m], shape (n, 2), unit vectors."""
        half = 0.5 * self.cell
        around = points[:, None] + half * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
        right, left, above, below = self.at(around.reshape(-1, 2)).reshape(-1, 4).T
        slope = np.stack([right - left, above - below], -1)
        return -slope / np.maximum(np.linalg.norm(slope, axis=-1, keepdims=True), 1e-12)

    def ahead(self, point: np.ndarray, length: float) -> np.ndarray:
        """Return the point of the way from a point that is some length ahead [m], shape (2,).

        It is the goal where that is nearer, or where no way is known.
        """
        at, value = point, float(self.at(point[None])[0])
        if value >= UNREACHABLE:
            return self.goal
        steps = int(length / self.cell)
        for left in reversed(range(steps)):
            straight = float(np.hypot(*(at - self.goal)))
            in_sight = straight <= left * self.cell and value <= straight + 0.1 * self.cell
            if straight <= self.cell or in_sight:
                return self.goal
            to = at + self.cell * self.downhill(at[None])[0]
            lower = float(self.at(to[None])[0])
            if lower > value - 0.5 * self.cell:  # over a ridge, or along a wall's cells
                to = self._lowest_near(at)
                lower = float(self.at(to[None])[0])
            if lower >= value:
                break
            at, value = to, lower
        return at

    def _lowest_near(self, point: np.ndarray) -> np.ndarray:
        """Return the centre of the lowest of the 9 cells around a point [m]."""
        rows, columns = self.values.shape
        column, row = np.clip(((point - self.origin) / self.cell).astype(int), 1, (columns - 2, rows - 2))
        near = self.values[row - 1 : row + 2, column - 1 : column + 2]
        j, i = divmod(int(near.argmin()), 3)
        if near[j, i] >= UNREACHABLE:
            i = j = 1
        return self.origin + self.cell * np.array([column + i - 0.5, row + j - 0.5])
