"""The planner: the shortest ways to the goal through what was seen. What was never seen counts as free.

As `planning.distance_field` and `warp_kernels.distance_field.solve`: the eikonal equation with first-order
upwind differences, blocked near things, slow around them. All cells are relaxed at once until the ways around
the robot are known. A plan may take some ticks, each of which relaxes so often at most.
"""

from __future__ import annotations

import math

import numpy as np

from spin_rl.deploy.pilot.costmap import Costmap
from spin_rl.deploy.pilot.field import UNREACHABLE, Field
from spin_rl.deploy.pilot.settings import Planner

_SLOWNESS = 4.0
"""Of cells nearer to things than `clearance_m`."""
_NEAR = 6
"""Cells around the goal with exact values."""
_BEYOND_M = 1.5
"""Ways that are longer than the robot's by so much are known."""
_PER_TICK = 60
"""Relaxations in a tick."""
_PER_LOOK = 10
"""Relaxations between two looks at whether that was enough."""
_IMPASSABLE = 1.0e6


class Route:
    """Plans in one episode.

    Attributes:
        field: The last plan.
    """

    def __init__(self, settings: Planner, start: np.ndarray, goal: np.ndarray, period_s: float) -> None:
        """Plan on an empty map.

        Args:
            settings: How to plan.
            start: Where the robot is in the frame of the odometry [m], shape (2,).
            goal: Where to, likewise.
            period_s: Time between two updates [s].
        """
        self._settings = settings
        self._side = round(settings.size_m / settings.cell_m)
        self.origin = 0.5 * (start + goal) - 0.5 * self._side * settings.cell_m
        self._wait = max(round(settings.replan_s / period_s), 1)
        self._planned_ago = 0
        self._goal = goal
        self._plan: _Plan | None = None
        none = np.zeros((0, 2))
        self.field = _Plan(settings, self.origin, goal, none, none).finish(start)

    @property
    def cell_m(self) -> float:
        """Side of a cell [m]."""
        return self._settings.cell_m

    def update(self, costmap: Costmap, place: np.ndarray) -> None:
        """Plan if there is news and the last plan is old enough; `place` is where the robot is [m]."""
        self._planned_ago += 1
        is_due = costmap.changed or self.field.at(place[None])[0] >= UNREACHABLE
        if self._plan is None and is_due and self._planned_ago >= self._wait:
            costmap.changed = False
            self._planned_ago = 0
            self._plan = _Plan(self._settings, self.origin, self._goal, *costmap.boxes())
        if self._plan is not None and self._plan.go_on(place, _PER_TICK):
            self.field, self._plan = self._plan.field, None

    def subgoal(self, place: np.ndarray) -> np.ndarray:
        """Return the point of the way that is ahead [m], shape (2,), or the goal; see `Field.ahead`."""
        return self.field.ahead(place, self._settings.ahead_m)


class _Plan:
    """A plan while it is made."""

    def __init__(
        self, settings: Planner, origin: np.ndarray, goal: np.ndarray, middle: np.ndarray, half: np.ndarray
    ) -> None:
        """Prepare costs and the values around the goal; `middle` and `half` are boxes of a `Costmap`."""
        self._cell = settings.cell_m
        side = round(settings.size_m / self._cell)
        self._blocked = settings.blocked_m
        clearance = max(settings.clearance_m, settings.blocked_m)
        self._distance = _distances(origin, self._cell, side, middle, half, clearance)
        passable = self._distance >= settings.blocked_m
        passable[[0, -1]] = passable[:, [0, -1]] = False
        slowness = np.where(self._distance < clearance, _SLOWNESS, 1.0)
        self._step = np.where(passable, slowness * self._cell, _IMPASSABLE).astype(np.float32)
        self._twice = 2.0 * self._step**2
        values = np.full((side, side), UNREACHABLE, dtype=np.float32)
        self.field = Field(values, origin, self._cell, goal)
        self._count = 0
        self._seed(middle, half, clearance)

    def finish(self, place: np.ndarray) -> Field:
        """Make all of it."""
        while not self.go_on(place, _PER_TICK):
            continue
        return self.field

    def go_on(self, place: np.ndarray, times: int) -> bool:
        """Relax so often at most; return whether the ways around a place [m] are known."""
        values = self.field.values
        for _ in range(times // _PER_LOOK):
            before = values.copy()
            for _ in range(_PER_LOOK):
                self._relax()
            # Every relaxation settles the cells up to a value that is so much higher.
            settled = self._count * math.sqrt(0.5) * self._cell
            if settled >= self._value_near(place) + _BEYOND_M or np.array_equal(before, values):
                self._extend()
                return True
        return False

    def _value_near(self, place: np.ndarray) -> float:
        side = len(self.field.values)
        reach = math.ceil(self._blocked / self._cell) + 1
        column, row = np.clip(((place - self.field.origin) / self._cell).astype(int), 1, side - 2)
        rows, columns = (slice(max(at - reach, 0), at + reach + 1) for at in (row, column))
        return float(self.field.values[rows, columns].min())

    def _relax(self) -> None:
        """Give the cells that ways have come to so far the values that their neighbours imply."""
        self._count += 1
        values, side = self.field.values, len(self.field.values)
        centre = ((self.field.goal - self.field.origin) / self._cell).astype(int)
        low = np.clip(centre - _NEAR - self._count, 1, side - 1)
        high = np.clip(centre + _NEAR + self._count + 1, 1, side - 1)
        (left, bottom), (right, top) = low.tolist(), high.tolist()
        rows, columns = slice(bottom, top), slice(left, right)
        found = _upwind(values, rows, columns, self._step[rows, columns], self._twice[rows, columns])
        np.minimum(values[rows, columns], found, out=values[rows, columns])

    def _extend(self) -> None:
        """Give blocked cells beside those with values one too: the robot's own point may be there."""
        values = self.field.values
        inner = slice(1, -1)
        step = np.full(1, _SLOWNESS * self._cell, dtype=np.float32)
        # Surfaces are as thin as they are seen: what they are in must not be passed.
        open_ = (self._distance < self._blocked) & (self._distance > 0.5 * self._cell)
        for _ in range(math.ceil(math.sqrt(2.0) * self._blocked / self._cell) + 1):
            found = _upwind(values, inner, inner, step, 2.0 * step * step)
            now = open_[inner, inner] & (values[inner, inner] >= UNREACHABLE) & (found < UNREACHABLE)
            values[inner, inner][now] = found[now]

    def _seed(self, middle: np.ndarray, half: np.ndarray, clearance: float) -> None:
        """Give the cells near the goal that see it past things their straight distance."""
        field, side = self.field, len(self.field.values)
        column, row = np.floor((field.goal - field.origin) / self._cell).astype(int)
        if not (1 <= column < side - 1 and 1 <= row < side - 1):
            return
        rows = np.arange(max(row - _NEAR, 1), min(row + _NEAR, side - 2) + 1)
        columns = np.arange(max(column - _NEAR, 1), min(column + _NEAR, side - 2) + 1)
        j, i = (axis.ravel() for axis in np.meshgrid(rows, columns, indexing="ij"))
        offset = self._cell * (np.stack([i, j], -1) + 0.5) + field.origin - field.goal
        straight = np.linalg.norm(offset, axis=-1)
        near = straight <= _NEAR * self._cell
        to, radius = middle - field.goal, np.linalg.norm(half, axis=-1)
        gap = np.linalg.norm(to, axis=-1)
        close = gap < _NEAR * self._cell + clearance + radius
        to, margin = to[close], np.minimum(clearance + radius, 0.7 * gap)[close]
        # Distances of the things' middles to the segments from the goal to the cells.
        share = np.clip(offset @ to.T / np.maximum(straight**2, 1e-9)[:, None], 0.0, 1.0)
        away = np.linalg.norm(to - share[..., None] * offset[:, None], axis=-1)
        near &= (away >= margin).all(-1)
        field.values[j[near], i[near]] = straight[near]


def _upwind(
    values: np.ndarray, rows: slice, columns: slice, step: np.ndarray, twice: np.ndarray
) -> np.ndarray:
    """Return what cells' values would be by their neighbours'; `twice` is twice the square of `step`."""

    def beside(i: int, j: int) -> np.ndarray:
        (bottom, top, _), (left, right, _) = (
            part.indices(size) for part, size in zip((rows, columns), values.shape, strict=True)
        )
        return values[bottom + j : top + j, left + i : right + i]

    a = np.minimum(beside(-1, 0), beside(1, 0))
    b = np.minimum(beside(0, -1), beside(0, 1))
    gap = np.minimum(np.abs(a - b), step)
    return np.minimum(a, b) + 0.5 * (gap + np.sqrt(twice - gap * gap))


def _distances(
    origin: np.ndarray, cell: float, side: int, middle: np.ndarray, half: np.ndarray, reach: float
) -> np.ndarray:
    """Return the distance of every cell's centre to the nearest box, `reach` where none is nearer [m]."""
    squared = np.full(side * side, reach * reach)
    most = math.ceil((reach + (half.max() if half.size else 0.0)) / cell + 0.5)
    steps = np.arange(-most, most + 1)
    at = np.floor((middle - origin) / cell).astype(int)
    gaps, cells = [], []
    for axis in range(2):
        index = at[:, axis, None] + steps
        centre = origin[axis] + cell * (index + 0.5)
        gap = np.maximum(np.abs(centre - middle[:, axis, None]) - half[:, axis, None], 0.0)
        gaps.append(np.where((index >= 0) & (index < side), gap, reach) ** 2)
        cells.append(np.clip(index, 0, side - 1))
    total = gaps[1][:, :, None] + gaps[0][:, None]
    close = total < reach * reach
    np.minimum.at(squared, (side * cells[1][:, :, None] + cells[0][:, None])[close], total[close])
    return np.sqrt(squared).reshape(side, side)
