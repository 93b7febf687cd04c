"""What a depth camera has seen of the surroundings: a grid in the frame of the odometry, with heights.

A cell knows in which layers something was seen in it, and the box around the points that were. What is below
the first of them counts as well, but where an image sees through: most things stand. What a later image sees
through is gone; so is what was not seen for long, sooner where the floor was seen shortly before.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spin_rl.deploy.kinematics import Frame
from spin_rl.deploy.pilot.eye import FAR_M, Eye

LAYER_M = 0.05
"""Height of a layer; each is a bit of a cell."""
CEILING_M = 1.45
"""Nothing of the robot is higher."""
FLOOR_M = 0.03
"""What is lower is the floor."""
_LAYERS = np.arange(round(CEILING_M / LAYER_M), dtype=np.uint32)
_MOVING_S = 10.0
"""What came to where the floor was is forgotten after so long."""
_CAME_S, _STAYS_S = 3.0, 2.0
"""The floor was seen so shortly before what came there; what is seen there so long after that stays."""
_LOW_M, _SPREAD_M = 0.09, 0.015
"""What is lower is gone where the floor is seen so near to what was seen of it."""
_STANDS_M = 0.15
"""What stands is not taken to reach lower: so near to the floor nothing is seen through from far."""
_FORGET_EVERY = 10
_ROOM_M, _STEP_M = 2.0, 1.0
"""A place is never so near to the map's edge; by how much more the map moves then."""
_NEVER = -(10**6)


def layers_between(low: float, high: float) -> np.uint32:
    """Return the bits of the layers that a span of heights [m] is in."""
    first, last = (int(np.clip(height / LAYER_M, 0, len(_LAYERS) - 1)) for height in (low, high))
    return np.uint32((1 << last + 1) - (1 << first))


def _bits(layers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return of every bit in an array which number it is in, and the layer, each of shape (bits,)."""
    which, layer = np.nonzero(layers[:, None] >> _LAYERS & np.uint32(1))
    return which, layer.astype(np.uint32)


@dataclass(frozen=True)
class Window:
    """A part of a map.

    Attributes:
        layers: Bits of the cells, see `layers_between`, shape (rows, columns), uint32.
        middle: Of the boxes around what was seen in them, x and y [m], shape (rows, columns, 2).
        half: Half extents of these [m], likewise; of no meaning in cells without bits.
    """

    layers: np.ndarray
    middle: np.ndarray
    half: np.ndarray


class Costmap:
    """The map of one episode. It goes along with a camera that gets near its edge.

    Attributes:
        changed: Whether cells became occupied or free since somebody set it to False.
    """

    def __init__(
        self, origin: np.ndarray, size_m: float, cell_m: float, *, memory_s: float, period_s: float
    ) -> None:
        """Start with nothing seen.

        Args:
            origin: Lower corner in the frame of the odometry [m], shape (2,).
            size_m: Side of the map [m].
            cell_m: Side of a cell [m].
            memory_s: Time after which what was not seen again is forgotten [s].
            period_s: Time between two images [s].
        """
        self._origin, self._cell = origin, cell_m
        self._side = n = round(size_m / cell_m)
        self._memory, self._moving, self._came, self._stays = (
            round(time / period_s) for time in (memory_s, _MOVING_S, _CAME_S, _STAYS_S)
        )
        self._layers = np.zeros(n * n, dtype=np.uint32)
        self._low = np.full((2, n * n), np.inf)
        self._high = np.full((2, n * n), -np.inf)
        self._seen_at, self._first_at, self._floor_at = (np.full(n * n, _NEVER) for _ in range(3))
        self._moves = np.zeros(n * n, dtype=bool)
        self._tick = 0
        self.changed = False

    def see(self, eye: Eye, depth: np.ndarray, camera: Frame, points: np.ndarray) -> None:
        """Take in an image.

        Args:
            eye: The camera.
            depth: Its image [m], 0 where nothing was measured.
            camera: Where it is, in the frame of the odometry.
            points: What it sees but the robot itself, in the frame of the odometry [m], shape (n, 3).
        """
        self._tick += 1
        self._go_along(camera.pos[:2])
        self._clear(eye, depth, camera)
        new = self._mark(points)
        self._stand(new, eye, depth, camera)
        if self._tick % _FORGET_EVERY == 0:
            self._forget()

    def around(self, point: np.ndarray, reach: float) -> Window:
        """Return the cells within a distance along x and y of a point [m]."""
        rows, columns = self._span(point[1], 1, reach), self._span(point[0], 0, reach)

        def part(values: np.ndarray) -> np.ndarray:
            return values.reshape(-1, self._side, self._side)[:, rows, columns]

        low, high = part(self._low), part(self._high)
        layers = part(self._layers)[0]
        middle, half = np.zeros((*layers.shape, 2)), np.zeros((*layers.shape, 2))
        taken = layers > 0
        low, high = low[:, taken].T, high[:, taken].T
        middle[taken], half[taken] = 0.5 * (low + high), 0.5 * (high - low)
        return Window(layers, middle, half)

    def boxes(self) -> tuple[np.ndarray, np.ndarray]:
        """Return middles and half extents of the boxes in all occupied cells [m], each of shape (n, 2)."""
        low, high = self._low[:, taken := self._layers > 0].T, self._high[:, taken].T
        return 0.5 * (low + high), 0.5 * (high - low)

    def _go_along(self, place: np.ndarray) -> None:
        """Move the map, by whole cells, where a place is near its edge; what is beyond is forgotten."""
        at, size = place - self._origin, self._side * self._cell
        room = min(_ROOM_M, 0.25 * size)
        beyond = np.minimum(at - room, 0.0) + np.maximum(at + room - size, 0.0)
        cells = np.rint((beyond + _STEP_M * np.sign(beyond)) / self._cell)
        if not cells.any():
            return
        self._origin, self.changed = self._origin + self._cell * cells, True
        index = np.arange(self._side) + cells[:, None]
        is_new = (index < 0.0) | (index >= self._side)
        shift = [-int(cells[axis] % self._side) for axis in (1, 0)]
        for values in (self._layers, self._low, self._high, self._seen_at, self._first_at, self._floor_at):
            grid = values.reshape(-1, self._side, self._side)
            grid[:] = np.roll(grid, shift, (1, 2))
        grid = self._moves.reshape(self._side, self._side)
        grid[:] = np.roll(grid, shift, (0, 1))
        new = np.flatnonzero(is_new[1][:, None] | is_new[0])
        self._layers[new] = 0
        self._floor_at[new] = _NEVER
        self._empty(new)

    def _span(self, at: float, axis: int, reach: float) -> slice:
        first, last = (
            int(np.clip((at + side - self._origin[axis]) // self._cell, 0, self._side - 1))
            for side in (-reach, reach)
        )
        return slice(first, last + 1)

    def _mark(self, points: np.ndarray) -> np.ndarray:
        """Take in points; return the cells in which nothing was before."""
        at = np.floor((points[:, :2] - self._origin) / self._cell).astype(int)
        inside = ((at >= 0) & (at < self._side)).all(-1) & (points[:, 2] < CEILING_M)
        cells, points = (at[:, 0] + self._side * at[:, 1])[inside], points[inside]
        is_floor = points[:, 2] < FLOOR_M
        self._clear_floor(cells[is_floor], points[is_floor])
        seen, things = cells[~is_floor], points[~is_floor]
        is_new = self._layers[seen] == 0
        new, old = seen[is_new], seen[~is_new]
        if new.size:
            self.changed = True
            self._first_at[new] = self._tick
            self._moves[new] = self._floor_at[new] >= self._tick - self._came
        self._moves[old[self._first_at[old] <= self._tick - self._stays]] = False
        np.bitwise_or.at(self._layers, seen, np.uint32(1) << (things[:, 2] / LAYER_M).astype(np.uint32))
        for axis in range(2):
            np.minimum.at(self._low[axis], seen, things[:, axis])
            np.maximum.at(self._high[axis], seen, things[:, axis])
        self._seen_at[seen] = self._tick
        self._floor_at[cells[is_floor]] = self._tick
        return np.unique(new)

    def _stand(self, cells: np.ndarray, eye: Eye, depth: np.ndarray, camera: Frame) -> None:
        """Let what was seen in cells reach down to near the floor, but where the image sees through."""
        layers = self._layers[cells]
        lowest = layers & (~layers + np.uint32(1))
        which, layer = _bits((lowest - np.uint32(1)) & ~layers_between(0.0, _STANDS_M - 0.5 * LAYER_M))
        stands = ~eye.sees_through(self._points(cells[which], layer), depth, camera)
        np.bitwise_or.at(self._layers, cells[which[stands]], np.uint32(1) << layer[stands])

    def _clear_floor(self, cells: np.ndarray, points: np.ndarray) -> None:
        """Take away what stood low where the floor is seen now: there is no depth to see through it."""
        at = points[:, :2].T
        stood = (at > self._low[:, cells] - _SPREAD_M) & (at < self._high[:, cells] + _SPREAD_M)
        cells = np.unique(cells[stood.all(0) & (self._layers[cells] > 0)])
        self._layers[cells] &= ~layers_between(0.0, _LOW_M)
        self._empty(cells[self._layers[cells] == 0])

    def _clear(self, eye: Eye, depth: np.ndarray, camera: Frame) -> None:
        rows, columns = self._span(camera.pos[1], 1, FAR_M), self._span(camera.pos[0], 0, FAR_M)
        row, column = np.nonzero(self._layers.reshape(self._side, self._side)[rows, columns])
        cells = (row + rows.start) * self._side + column + columns.start
        which, layer = _bits(self._layers[cells])
        gone = eye.sees_through(self._points(cells[which], layer), depth, camera)
        cells = cells[which[gone]]
        np.bitwise_and.at(self._layers, cells, ~(np.uint32(1) << layer[gone]))
        self._empty(cells[self._layers[cells] == 0])

    def _points(self, cells: np.ndarray, layer: np.ndarray) -> np.ndarray:
        """Return the middles of layers of cells, each of shape (n,), in the frame of the odometry, (n, 3)."""
        middle = 0.5 * (self._low[:, cells] + self._high[:, cells])
        return np.stack([*middle, (layer + 0.5) * LAYER_M], -1)

    def _forget(self) -> None:
        most = np.where(self._moves, min(self._moving, self._memory), self._memory)
        old = np.flatnonzero((self._layers > 0) & (self._seen_at < self._tick - most))
        self._layers[old] = 0
        self._empty(old)

    def _empty(self, cells: np.ndarray) -> None:
        if cells.size:
            self.changed = True
            self._low[:, cells], self._high[:, cells] = np.inf, -np.inf
