"""Path search for the Stretch in a scene: is there a way from start to goal, and which?

A search over a lattice of base poses with the robot's collision shape, in which the arm stays stowed at one
of a few lift heights. The lattice's moves are those of a differential drive: straight along the heading,
either way, and turns in place. Positions are exact at lattice points, so that a path found here can be
driven; a way narrower than the lattice may be missed.

Needs the `planner` extra (SciPy).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spin_rl.planning.collision import blocked_poses, extent
from spin_rl.scenes.layout import Scene

LIFT_HEIGHTS_M = (0.35, 0.6, 0.9)
"""Lift positions that a path may choose from."""

RESOLUTION_M = 0.04
GOAL_TOLERANCE_M = 0.15

# Headings that go through lattice points, one quadrant: (0, 14.0, 26.6, 45, 63.4, 76.0) degrees.
_QUADRANT = ((1, 0), (4, 1), (2, 1), (1, 1), (1, 2), (1, 4))
_STEPS = np.array(
    [(c * x - s * y, s * x + c * y) for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1)) for x, y in _QUADRANT]
)
HEADINGS_RAD = np.arctan2(_STEPS[:, 1], _STEPS[:, 0])
"""Yaws of the lattice, shape (24,)."""


@dataclass(frozen=True)
class Path:
    """A way from start to goal.

    Attributes:
        poses: Base poses (x [m], y [m], yaw [rad]) in the world, shape (n, 3).
        lift: Lift position on the whole way [m].
    """

    poses: np.ndarray
    lift: float


def find_path(scene: Scene) -> Path | None:
    """Search for a way from the start to within `GOAL_TOLERANCE_M` of the goal.

    Args:
        scene: The world; its start joints are ignored (the robot stows first).

    Returns:
        A path for the first lift height that has one, or None.
    """
    grid = _Grid.around(scene, RESOLUTION_M)
    for lift in LIFT_HEIGHTS_M:
        tree = _explore(grid, ~blocked_poses(scene, grid.x, grid.y, HEADINGS_RAD, lift), scene.start[2])
        node = None if tree is None else tree.first_at(grid, scene.goal)
        if tree is not None and node is not None:
            return Path(poses=tree.way_to(grid, node), lift=lift)
    return None


def reachable(scene: Scene, places: np.ndarray, resolution: float = RESOLUTION_M) -> np.ndarray:
    """Which places have a way from the start; it can be driven in both directions.

    Args:
        scene: The world; its start joints and its goal are ignored.
        places: Positions [m], shape (n, 2).
        resolution: Between lattice points [m]; a coarse lattice is fast and misses narrow ways.

    Returns:
        Shape (n,), bool.
    """
    grid = _Grid.around(scene, resolution)
    found = np.zeros(len(places), dtype=bool)
    for lift in LIFT_HEIGHTS_M:
        tree = _explore(grid, ~blocked_poses(scene, grid.x, grid.y, HEADINGS_RAD, lift), scene.start[2])
        if tree is not None:
            found |= np.array([tree.first_at(grid, place) is not None for place in places])
        if found.all():
            break
    return found


@dataclass(frozen=True)
class _Grid:
    """Lattice positions; the start is one of them."""

    x: np.ndarray
    y: np.ndarray
    start: tuple[int, int]  # (row, column)

    @staticmethod
    def around(scene: Scene, resolution: float) -> _Grid:
        """A lattice over the scene's slots, start and goal."""
        corners = [scene.start[:2], scene.goal]
        for slot in np.flatnonzero(scene.active):
            reach = extent(scene.half_size[slot], scene.yaw[slot])
            corners += [scene.pos[slot, :2] - reach, scene.pos[slot, :2] + reach]
        before = np.ceil((scene.start[:2] - np.min(corners, axis=0)) / resolution).astype(int)
        after = np.ceil((np.max(corners, axis=0) - scene.start[:2]) / resolution).astype(int)
        # Start and goal may be nearly aligned on an open floor; `_between` needs points for the longest step.
        after = np.maximum(after, np.abs(_STEPS).max() - 1 - before)
        x, y = (scene.start[i] + resolution * np.arange(-before[i], after[i] + 1) for i in range(2))
        return _Grid(x=x, y=y, start=(int(before[1]), int(before[0])))


@dataclass(frozen=True)
class _Tree:
    """Shortest ways from the start to all poses that have one; nodes are flat indices of the lattice."""

    shape: tuple[int, ...]
    order: np.ndarray  # nodes, nearest to the start first
    before: np.ndarray  # the node before each node, negative for the start

    def first_at(self, grid: _Grid, place: np.ndarray) -> int | None:
        """The nearest node within `GOAL_TOLERANCE_M` of a place."""
        _, row, column = np.unravel_index(self.order, self.shape)
        there = np.hypot(grid.x[column] - place[0], grid.y[row] - place[1]) <= GOAL_TOLERANCE_M
        return int(self.order[np.argmax(there)]) if there.any() else None

    def way_to(self, grid: _Grid, node: int) -> np.ndarray:
        """Poses from the start to a node, shape (n, 3)."""
        way = []
        while node >= 0:
            way.append(node)
            node = int(self.before[node])
        h, row, column = np.unravel_index(way[::-1], self.shape)
        return np.stack([grid.x[column], grid.y[row], HEADINGS_RAD[h]], axis=1)


def _explore(grid: _Grid, free: np.ndarray, start_yaw: float) -> _Tree | None:
    """Search the free poses from the start; None if it has no free heading."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import breadth_first_order

    yaw_error = np.abs(np.angle(np.exp(1j * (HEADINGS_RAD - start_yaw))))
    # The start itself is clear; its nearest lattice heading may not be.
    heading = next((int(h) for h in np.argsort(yaw_error)[:2] if free[(h, *grid.start)]), None)
    if heading is None:
        return None
    nodes = np.arange(free.size).reshape(free.shape)
    edges = _turns(nodes, free) + _straights(nodes, free)
    ends = [np.concatenate(side) for side in zip(*edges, strict=True)]
    graph = coo_matrix((np.ones(len(ends[0]), dtype=np.int8), ends), shape=(free.size, free.size)).tocsr()
    order, before = breadth_first_order(graph, nodes[(heading, *grid.start)], directed=False)
    return _Tree(free.shape, order, before)


def _turns(nodes: np.ndarray, free: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Edges between neighbouring headings at one position."""
    keep = free & np.roll(free, -1, axis=0)
    return [(nodes[keep], np.roll(nodes, -1, axis=0)[keep])]


def _straights(nodes: np.ndarray, free: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Edges along the headings; the lattice points nearest to the way between must be free as well."""
    edges = []
    for heading, (dx, dy) in enumerate(_STEPS):
        points = max(abs(dx), abs(dy))
        here, keep = _shifted(free[heading], dx, dy)
        keep = keep & here
        for i in range(1, points):
            px, py = round(i * dx / points), round(i * dy / points)
            keep &= _between(free[heading], px, py, dx, dy)
        a, b = _shifted(nodes[heading], dx, dy)
        edges.append((a[keep], b[keep]))
    return edges


def _shifted(array: np.ndarray, dx: int, dy: int) -> tuple[np.ndarray, np.ndarray]:
    """Views of an array (y, x) and of itself shifted by (dx, dy), over the indices that both have."""
    return _between(array, 0, 0, dx, dy), _between(array, dx, dy, dx, dy)


def _between(array: np.ndarray, px: int, py: int, dx: int, dy: int) -> np.ndarray:
    """View of an array (y, x) shifted by (px, py), where a shift by (dx, dy) stays inside."""
    ny, nx = array.shape
    x0, y0 = max(0, -dx), max(0, -dy)
    return array[y0 + py : ny - max(0, dy) + py, x0 + px : nx - max(0, dx) + px]
