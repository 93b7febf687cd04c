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
        nx: Cells along x.
        ny: Cells along y.
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
        if not (self.cell_m > 0.0 and self.rings <= MAX_RINGS):
            raise ValueError(f"cell_m must be at least 0.02, got {self.cell_m}")

    @property
    def blocked_m(self) -> float:
        """Distance to obstacles below which no way leads through [m].

        A passage that the base fits through has a cell's centre within 0.71 cells of its middle line wherever
        the cells lie; half a cell keeps thin walls closed.
        """
        return max(BASE_HALF_WIDTH_M - math.sqrt(0.5) * self.cell_m, 0.5 * self.cell_m)

    @property
    def rings(self) -> int:
        """Cells from passable ones to an obstacle's surface, at most."""
        return math.ceil(math.sqrt(2.0) * self.blocked_m / self.cell_m) + 1

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
        nx, ny = np.ceil((high - low) / cell).astype(int)
        return GridSpec(int(nx), int(ny), cell, (float(low[0]), float(low[1])))


class DistanceField:
    """The fields of all worlds and the buffers to compute them, allocated once.

    Attributes:
        field: What kernels read with `field_at` of `spin_rl.warp_kernels.distance_field.field`. Its
            ``origin`` may be written per world before an update.
        grid: The cells.
    """

    def __init__(
        self,
        slots: SlotArrays,
        device: str,
        grid: GridSpec | None = None,
        *,
        clearance_m: float = CLEARANCE_M,
    ) -> None:
        """Allocate the buffers and keep references to the arrays that `update` reads.

        Args:
            slots: Obstacles, shape (nworld, nslot).
            device: Warp device.
            grid: The cells; by default 12 x 12 m around the world's origin in cells of 0.1 m.
            clearance_m: Distance to obstacles from which a way costs no more than its length, at least the
                grid's `blocked_m`.

        Raises:
            ValueError: The clearance is less than that.
        """
        self.grid = grid = grid or GridSpec()
        if clearance_m < grid.blocked_m:
            raise ValueError(f"clearance_m must be at least {grid.blocked_m:.3f}, got {clearance_m}")
        self._clearance = clearance_m
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
            ceiling=CEILING_M,
            clearance=self._clearance,
            blocked=self.grid.blocked_m,
            rings=self.grid.rings,
        )
