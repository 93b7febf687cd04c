# pyright: reportGeneralTypeIssues=false
# (to a type checker, a Warp struct is an object, not a class)
"""Obstacles thrown into the way of trips through a scene: some that lie there, and one that steps in.

A trip is kept where a way as wide as the turning robot remains, also when the one that steps in stands there
(`planning.distance_field`): with the margin used here the lattice planner finds a way wherever there is one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import warp as wp

from spin_rl.planning.distance_field import DistanceField, GridSpec
from spin_rl.scenes.layout import Layout, PoolSpec, Scene, fit_to_pool
from spin_rl.warp_kernels.distance_field.field import UNREACHABLE

_DEVICE = "cpu"
_BLOCKED_M = 0.25
_CELL_M = 0.05
_MOST_CELLS = 80_000
_ROUNDS = 40
_TRIES = 30
_LEAST_POINTS = 20
"""Of a way that something can be thrown into, a metre."""
_BASE_M = 0.35
"""From the base's point to its farthest corner."""


@dataclass(frozen=True)
class Throw:
    """What is thrown; pairs are (low, high) of a uniform draw.

    Attributes:
        lying: How many boxes lie there.
        half_size: Half the sides of a box [m].
        height: Of a box [m].
        aside: Standard deviation of a box's distance to the way [m].
        radius: Of the one that steps in, as of a person [m].
        tall: Its height [m].
        way: Its way into the robot's way [m].
        speed: Its speed [m/s].
        trigger: Distance of the robot from where it steps at which it starts [m].
        share: Where on the way that is, 0 the start and 1 the goal.
    """

    lying: int = 4
    half_size: tuple[float, float] = (0.1, 0.25)
    height: tuple[float, float] = (0.3, 1.0)
    aside: float = 0.5
    radius: float = 0.2
    tall: float = 1.7
    way: tuple[float, float] = (0.7, 1.2)
    speed: tuple[float, float] = (0.6, 1.0)
    trigger: tuple[float, float] = (1.2, 1.7)
    share: tuple[float, float] = (0.3, 0.75)


@dataclass(frozen=True)
class ThrownTrips:
    """Trips with and without the one that steps in, which else are the same.

    Attributes:
        static: With what lies there alone.
        dynamic: With the one that steps in as well.
    """

    static: list[Scene]
    dynamic: list[Scene]


def throw_into(trips: Sequence[Scene], throw: Throw, *, count: int, seed: int) -> ThrownTrips:
    """Throw obstacles into the ways of trips.

    Args:
        trips: Scenes of one pool, in which nothing moves; those in which no draw leaves a way are left out.
        throw: What to throw.
        count: How many of them to return, the first ones.
        seed: Random seed; all depends on nothing but the arguments.

    Raises:
        ValueError: There are fewer.
    """
    rng = np.random.default_rng(seed)
    pool = trips[0].pool
    wider = PoolSpec(pool.num_walls, pool.num_boxes + throw.lying, pool.num_cylinders + 1)
    empty = [fit_to_pool(trip, wider) for trip in trips]
    ways = _Ways(empty)
    ways_of = {i: path for i, path in enumerate(ways.paths(empty)) if path is not None}
    done: dict[int, tuple[Scene, Scene]] = {}
    hopeful = [i for i, path in ways_of.items() if len(path) > _LEAST_POINTS]
    for _ in range(_ROUNDS):
        left = [i for i in hopeful if i not in done]
        if not left:
            break
        static = [_with_boxes(empty[i], ways_of[i], throw, rng) for i in left]
        found = ways.paths(static)
        dynamic = [
            None if path is None else _with_walker(scene, path, throw, rng)
            for scene, path in zip(static, found, strict=True)
        ]
        there = [
            scene if one is None else _stepped_in(one) for one, scene in zip(dynamic, static, strict=True)
        ]
        for i, scene, one, path in zip(left, static, dynamic, ways.paths(there), strict=True):
            if one is not None and path is not None:
                done[i] = scene, one
    if len(done) < count:
        raise ValueError(
            f"scene: obstacles leave a way in {len(done)} of {len(empty)} trips, {count} are needed"
        )
    pairs = [done[i] for i in sorted(done)[:count]]
    return ThrownTrips([static for static, _ in pairs], [dynamic for _, dynamic in pairs])


class _Ways:
    """Shortest ways in many scenes at once."""

    def __init__(self, scenes: Sequence[Scene]) -> None:
        self._layout = Layout(len(scenes), scenes[0].pool, _DEVICE)
        grid = GridSpec.around(scenes, cell_m=_CELL_M, max_cells=_MOST_CELLS)
        self._field = DistanceField(self._layout, _DEVICE, grid, blocked_m=_BLOCKED_M)

    def paths(self, scenes: Sequence[Scene]) -> list[np.ndarray | None]:
        """Points of the ways of no more scenes than there were, None where there is no way."""
        count = len(scenes)
        self._layout.load_each([*scenes, *[scenes[0]] * (self._layout.nworld - count)])
        mask = wp.array(np.arange(self._layout.nworld) < count, dtype=bool, device=_DEVICE)
        self._field.update(self._layout.goal, mask)
        self._field.trace(self._layout.start, mask)
        lengths = self._field.path_length.numpy()
        return [self._field.path(i) if lengths[i] < UNREACHABLE else None for i in range(count)]


def _with_boxes(scene: Scene, path: np.ndarray, throw: Throw, rng: np.random.Generator) -> Scene:
    """Let boxes lie about the way, clear of start and goal."""
    thrown = _copy(scene)
    for slot in range(scene.pool.first_cylinder - throw.lying, scene.pool.first_cylinder):
        half = np.array([*rng.uniform(*throw.half_size, 2), 0.5 * rng.uniform(*throw.height)])
        for _ in range(_TRIES):
            place, across = _on_way(path, rng.random())
            place = place + across * throw.aside * rng.standard_normal()
            if _keeps_off(scene, place, float(np.hypot(*half[:2]))):
                break
        else:
            continue
        thrown.pos[slot], thrown.half_size[slot] = (*place, half[2]), half
        thrown.yaw[slot], thrown.active[slot] = rng.uniform(-np.pi, np.pi), True
    return thrown


def _with_walker(scene: Scene, path: np.ndarray, throw: Throw, rng: np.random.Generator) -> Scene | None:
    """Let somebody wait beside the way who steps into it; None where there is no room."""
    slot = scene.pool.num_slots - 1
    for _ in range(_TRIES):
        home, across = _on_way(path, rng.uniform(*throw.share))
        retreat = across * rng.uniform(*throw.way) * rng.choice([-1.0, 1.0])
        steps = home + np.linspace(0.0, 1.0, 8)[:, None] * retreat
        free = all(_gap(scene, place) > throw.radius + 0.02 for place in steps)
        if not free or not all(_keeps_off(scene, place, throw.radius) for place in (home, steps[-1])):
            continue
        thrown = _copy(scene)
        thrown.active[slot] = True
        thrown.half_size[slot] = throw.radius, throw.radius, 0.5 * throw.tall
        thrown.home[slot] = (*home, 0.5 * throw.tall)
        thrown.pos[slot] = (*steps[-1], 0.5 * throw.tall)
        thrown.retreat[slot] = retreat
        thrown.motion_speed[slot] = rng.uniform(*throw.speed)
        thrown.motion_trigger[slot] = rng.uniform(*throw.trigger)
        return thrown
    return None


def _stepped_in(scene: Scene) -> Scene:
    """Return the scene with the one that steps in where it steps to, for good."""
    slot = scene.pool.num_slots - 1
    there = _copy(scene)
    there.pos[slot] = scene.home[slot]
    return there


def _copy(scene: Scene) -> Scene:
    return replace(
        scene, **{key: value.copy() for key, value in vars(scene).items() if isinstance(value, np.ndarray)}
    )


def _on_way(path: np.ndarray, share: float) -> tuple[np.ndarray, np.ndarray]:
    """A place on a way, at a share of its points, and the direction across it."""
    i = min(int(share * (len(path) - 1)), len(path) - 2)
    j = min(i + 4, len(path) - 1)
    along = path[j] - path[i]
    along = along / max(float(np.linalg.norm(along)), 1e-6)
    return path[i].astype(np.float64), np.array([-along[1], along[0]])


def _keeps_off(scene: Scene, place: np.ndarray, reach: float) -> bool:
    """Whether something so large leaves start and goal free for a robot that turns there."""
    ends = np.stack((scene.start[:2], scene.goal))
    return bool((np.linalg.norm(ends - place, axis=1) > reach + _BASE_M + 0.1).all())


def _gap(scene: Scene, place: np.ndarray) -> float:
    """Distance of a place on the floor to what stands there [m]; 0 inside."""
    offset = place - scene.pos[:, :2]
    c, s = np.cos(scene.yaw), np.sin(scene.yaw)
    x, y = c * offset[:, 0] + s * offset[:, 1], c * offset[:, 1] - s * offset[:, 0]
    outside = np.maximum(np.abs(np.stack((x, y), axis=1)) - scene.half_size[:, :2], 0.0)
    box = np.hypot(outside[:, 0], outside[:, 1])
    round_ = np.maximum(np.hypot(x, y) - scene.half_size[:, 0], 0.0)
    gaps = np.where(scene.is_cylinder, round_, box)[scene.active]
    return float(gaps.min(initial=np.inf))
