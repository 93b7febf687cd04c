"""Distance fields: how long the shortest passable way to the goal is, from anywhere in every world."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from spin_rl.scenes.layout import Scene
from spin_rl.warp_kernels.distance_field.field import Field
from spin_rl.warp_kernels.distance_field.solve import MAX_RINGS, solve_distance_field
from spin_rl.warp_kernels.distance_field.trace import trace_paths
from spin_rl.warp_kernels.slots import SlotArrays, slots_of

BASE_HALF_WIDTH_M = 0.182
"""What must fit through a passage on either side of the base's point."""

CLEARANCE_M = 0.21
"""Distance to obstacles from which a way costs no more than its length."""

CEILING_M = 1.45
"""Nothing of the robot is higher."""

_ROOM_M = 0.5
"""Room around a scene's slots, start and goal."""


@dataclass(frozen=True)
class GridSpec:
    """The cells of a distance field.

    Passages as wide as the base (or 2.4 cells, if that is more) are always open; those narrower than twice
    `blocked_m`, 0.22 m with the default cells, never; between, it depends on where the cells lie.

    Attributes:
        nx: Cells along x, with one at either end that is only a frame.
        ny: Cells along y, likewise.
        cell_m: Side of a cell.
        origin: Lower corner of the grid in the world [m].
    """

    nx: int = 120
    ny: int = 120
    cell_m: float = 0.1
    origin: tuple[float, float] = (-6.0, -6.0)

    def __post_init__(self) -> None:
        """Reject grids that cannot be solved."""
        if min(self.nx, self.ny) < 4:
            raise ValueError(f"a grid needs 4 cells along each axis, got nx {self.nx} and ny {self.ny}")
        if not self.cell_m > 0.0:
            raise ValueError(f"cell_m must be positive, got {self.cell_m}")

    @property
    def blocked_m(self) -> float:
        """Distance to obstacles below which no way leads through [m].

        A passage that the base fits through has a cell's centre within 0.71 cells of its middle line wherever
        the cells lie; half a cell keeps thin walls closed.
        """
        return max(BASE_HALF_WIDTH_M - math.sqrt(0.5) * self.cell_m, 0.5 * self.cell_m)

    @staticmethod
    def square(size_m: float, cell_m: float = 0.1) -> GridSpec:
        """A square of some side around the world's origin."""
        n = math.ceil(size_m / cell_m - 1e-6)
        return GridSpec(n, n, cell_m, (-0.5 * n * cell_m, -0.5 * n * cell_m))

    @staticmethod
    def around(scenes: Sequence[Scene], *, cell_m: float = 0.1, max_cells: int = 40_000) -> GridSpec:
        """A grid over the slots, starts and goals of scenes, with cells as coarse as `max_cells` demands."""
        corners = []
        for scene in scenes:
            half, yaw = scene.half_size[scene.active], scene.yaw[scene.active, None]
            reach = np.abs(np.cos(yaw)) * half[:, :2] + np.abs(np.sin(yaw)) * half[:, 1::-1]
            centre = scene.pos[scene.active, :2]
            corners += [centre - reach, centre + reach, scene.start[None, :2], scene.goal[None]]
        points = np.concatenate(corners)
        low, high = points.min(axis=0) - _ROOM_M, points.max(axis=0) + _ROOM_M
        cell = max(cell_m, math.sqrt(float(np.prod(high - low)) / max_cells))
        nx, ny = np.ceil((high - low) / cell).astype(int) + 2  # with the frame
        return GridSpec(int(nx), int(ny), cell, (float(low[0] - cell), float(low[1] - cell)))


class DistanceField:
    """The fields of all worlds and the buffers to compute them, allocated once.

    Attributes:
        field: What kernels read with `field_at` of `spin_rl.warp_kernels.distance_field.field`. Its
            ``origin`` may be written per world before an update.
        grid: The cells.
        near: With `beyond_m`, a cell of each world, row by row, to be written before an update, (nworld,).
        path_length: Lengths of the ways last traced [m], shape (nworld,); `UNREACHABLE` where there is none.
    """

    def __init__(
        self,
        slots: SlotArrays,
        device: str,
        grid: GridSpec | None = None,
        *,
        clearance_m: float = CLEARANCE_M,
        blocked_m: float | None = None,
        beyond_m: float | None = None,
    ) -> None:
        """Allocate the buffers and keep references to the arrays that `update` reads.

        Args:
            slots: Obstacles, shape (nworld, nslot).
            device: Warp device.
            grid: The cells; by default 12 x 12 m around the world's origin in cells of 0.1 m.
            clearance_m: Distance to obstacles from which a way costs no more than its length, or
                `blocked_m`, if that is more.
            blocked_m: Distance below which no way leads through; the grid's if None: then the goal can be
                reached from wherever the robot finds a way, and from more. With 0.16 m that agrees with the
                lattice planner in 75 of 80 cluttered rooms (64 by default); with 0.25 m the planner found a
                way wherever there is one here, and in 29 others.
            beyond_m: With it, only ways are sought that, with the straight line from the cells `near` to
                their beginning, are longer than from there by no more than so much; None finds all.

        Raises:
            ValueError: `blocked_m` is less than the grid's or too many cells.
        """
        self.grid = grid = grid or GridSpec()
        blocked = grid.blocked_m if blocked_m is None else blocked_m
        if blocked < grid.blocked_m:
            raise ValueError(f"blocked_m must be at least {grid.blocked_m:.3f}, got {blocked}")
        # Cells from passable ones to an obstacle's surface, at most.
        self._rings = math.ceil(math.sqrt(2.0) * blocked / grid.cell_m) + 1
        if self._rings > MAX_RINGS:
            raise ValueError(f"cell_m must be at least {0.11 * blocked:.3f}, got {grid.cell_m}")
        self._clearance, self._blocked = max(clearance_m, blocked), blocked
        self._beyond = beyond_m or 0.0
        self._obstacles = slots_of(slots)
        nworld = slots.pos.shape[0]
        shape = (nworld, grid.ny, grid.nx)
        self.field = Field()
        self.field.cell = grid.cell_m
        with wp.ScopedDevice(device):
            self.field.values = wp.zeros(shape, dtype=float)
            self.field.origin = wp.full(nworld, wp.vec2(*grid.origin), dtype=wp.vec2)
            self.field.goal = wp.zeros(nworld, dtype=wp.vec2)
            self._kinds = wp.zeros(shape, dtype=wp.int32)
            self._queue = wp.zeros((nworld, grid.ny * grid.nx), dtype=wp.int32)
            whole = wp.vec4i(0, 0, 1 - grid.nx, 1 - grid.ny)
            self._box = wp.full(nworld, whole, dtype=wp.vec4i)
            self.near = wp.zeros(0 if beyond_m is None else nworld, dtype=wp.int32)
            self.path_length = wp.zeros(nworld, dtype=float)
            self._path = wp.zeros((nworld, 2 * (grid.nx + grid.ny)), dtype=wp.vec2)
            self._path_points = wp.zeros(nworld, dtype=wp.int32)

    def update(self, goal: wp.array, mask: wp.array) -> None:
        """Compute the fields of the masked worlds from the slots where they are now; graph-safe.

        Args:
            goal: Where ways end [m], shape (nworld,), vec2; copied.
            mask: Worlds to compute, shape (nworld,), bool.
        """
        solve_distance_field(
            self._obstacles,
            goal,
            mask,
            self.field,
            kinds=self._kinds,
            queue=self._queue,
            box=self._box,
            ceiling=CEILING_M,
            clearance=self._clearance,
            blocked=self._blocked,
            rings=self._rings,
            near=self.near,
            beyond=self._beyond,
        )

    def trace(self, start: wp.array, mask: wp.array) -> None:
        """Follow the shortest ways of the masked worlds and measure them, after an update; graph-safe.

        Unlike the values, lengths count no extra for being near obstacles.

        Args:
            start: Base poses (x [m], y [m], yaw [rad]), shape (nworld,), vec3.
            mask: Worlds to follow, shape (nworld,), bool.
        """
        trace_paths(
            self.field,
            start,
            mask,
            length_out=self.path_length,
            points_out=self._path,
            count_out=self._path_points,
        )

    def path(self, world: int) -> np.ndarray:
        """Copy the way last traced in a world to the host, for drawings.

        Returns:
            Points from start to goal [m], about a cell apart, shape (n, 2); none where there is no way.
        """
        return self._path.numpy()[world, : self._path_points.numpy()[world]]
