"""What a world contains, as plain arrays: walls, obstacles, start and goal.

Generator, physics, scandots, depth, planner and viewer all read these arrays. The frame is the world's: z up,
the floor at z = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

NUM_JOINTS = 8
"""Joints of a start pose, in the order of `spin_rl.robot.JOINTS`."""


MOST_SLOTS = 1000
"""Of a kind: physics has memory for every slot of every world."""


@dataclass(frozen=True)
class PoolSpec:
    """The scene geoms that every world owns; slots are ordered walls, boxes, cylinders.

    Attributes:
        num_walls: Wall slots (boxes).
        num_boxes: Box slots.
        num_cylinders: Upright cylinder slots.
    """

    num_walls: int = 6
    num_boxes: int = 7
    num_cylinders: int = 3

    def __post_init__(self) -> None:
        """Reject counts that no pool can have."""
        for name in ("num_walls", "num_boxes", "num_cylinders"):
            if not 0 <= getattr(self, name) <= MOST_SLOTS:
                raise ValueError(
                    f"pool.{name} must not be negative nor above {MOST_SLOTS}, got {getattr(self, name)}"
                )
        if self.num_slots == 0:
            raise ValueError("a pool needs at least one slot")

    @property
    def num_slots(self) -> int:
        """Slots of one world."""
        return self.num_walls + self.num_boxes + self.num_cylinders

    @property
    def first_box(self) -> int:
        """Slot of the first box."""
        return self.num_walls

    @property
    def first_cylinder(self) -> int:
        """Slot of the first cylinder."""
        return self.num_walls + self.num_boxes

    def geom_names(self) -> list[str]:
        """MuJoCo geom names in slot order."""
        return (
            [f"wall_{i}" for i in range(self.num_walls)]
            + [f"box_{i}" for i in range(self.num_boxes)]
            + [f"cylinder_{i}" for i in range(self.num_cylinders)]
        )


@dataclass
class Scene:
    """One world on the host: the same fields as `Layout`, without the leading world axis.

    Attributes:
        pool: Number of slots of each kind.
        pos: Slot centres [m], of moving slots where they are now, shape (nslot, 3).
        yaw: Slot yaws about z [rad], shape (nslot,).
        half_size: Half extents of boxes; (radius, radius, half height) of cylinders [m], shape (nslot, 3).
        active: Slots that exist, shape (nslot,), bool.
        start: Base pose (x [m], y [m], yaw [rad]), shape (3,).
        start_joints: Joint positions in `spin_rl.robot.JOINTS` order [m or rad], shape (8,).
        goal: Where the base should go [m], shape (2,).
        home: Where a moving slot comes out farthest [m], shape (nslot, 3); of no meaning for the others.
        retreat: From there to where it starts or turns back [m], shape (nslot, 2).
        motion_speed: Speed of the slot [m/s], 0 for one that never moves, shape (nslot,).
        motion_trigger: Distance of the base from `home` at which the slot comes out [m], shape (nslot,); 0
            for one that slides to and fro.
        motion_phase: Where in its period the latter starts, in [0, 1), 0 at the far end of `retreat`, shape
            (nslot,).
        bend: 0 straight, 1 L-shaped.
        scenario: 1 or 2, the paper's scenarios; 0 where it is none of them.
        difficulty: 0 easy, 1 medium, 2 hard.
        num_obstacles: Obstacles between start and goal; distractors do not count.
        family: Kind of place, an index of `kinds.FAMILIES`.
        way_m: Length of the shortest way from start to goal [m]; 0 where nobody measured it.
    """

    pool: PoolSpec
    pos: np.ndarray
    yaw: np.ndarray
    half_size: np.ndarray
    active: np.ndarray
    start: np.ndarray
    start_joints: np.ndarray
    goal: np.ndarray
    home: np.ndarray
    retreat: np.ndarray
    motion_speed: np.ndarray
    motion_trigger: np.ndarray
    motion_phase: np.ndarray
    bend: int = 0
    scenario: int = 1
    difficulty: int = 0
    num_obstacles: int = 0
    family: int = 0
    way_m: float = 0.0

    @property
    def is_wall(self) -> np.ndarray:
        """Which slots are walls, shape (nslot,), bool."""
        return np.arange(self.pool.num_slots) < self.pool.first_box

    @property
    def is_cylinder(self) -> np.ndarray:
        """Which slots are cylinders, shape (nslot,), bool."""
        return np.arange(self.pool.num_slots) >= self.pool.first_cylinder

    @property
    def moves(self) -> bool:
        """Whether anything moves."""
        return bool((self.motion_speed[self.active] > 0.0).any())

    @staticmethod
    def empty(pool: PoolSpec) -> Scene:
        """A scene without active slots, start and goal at the origin, joints at zero."""
        n = pool.num_slots
        return Scene(
            pool=pool,
            pos=np.zeros((n, 3)),
            yaw=np.zeros(n),
            half_size=np.full((n, 3), 0.05),
            active=np.zeros(n, dtype=bool),
            start=np.zeros(3),
            start_joints=np.zeros(NUM_JOINTS),
            goal=np.zeros(2),
            home=np.zeros((n, 3)),
            retreat=np.zeros((n, 2)),
            motion_speed=np.zeros(n),
            motion_trigger=np.zeros(n),
            motion_phase=np.zeros(n),
        )


class Layout:
    """The scenes of all worlds on one device. Arrays are allocated once and written in place.

    Attributes:
        pos: Slot centres [m], of moving slots where they are now, shape (nworld, nslot), vec3.
        yaw: Slot yaws about z [rad], shape (nworld, nslot).
        half_size: Half extents of boxes; (radius, radius, half height) of cylinders [m], shape (nworld,
            nslot), vec3.
        active: Slots that exist, shape (nworld, nslot), bool.
        is_cylinder: Which slots are cylinders, shape (nslot,), bool.
        is_wall: Which slots are walls, shape (nslot,), bool.
        start: Base pose (x [m], y [m], yaw [rad]), shape (nworld,), vec3.
        start_joints: Joint positions in `spin_rl.robot.JOINTS` order [m or rad], shape (nworld, 8).
        goal: Where the base should go [m], shape (nworld,), vec2.
        bend: 0 straight, 1 L-shaped, shape (nworld,), int32.
        scenario: 1 or 2, the paper's scenarios, 0 where it is none of them, shape (nworld,), int32.
        difficulty: 0 easy, 1 medium, 2 hard, shape (nworld,), int32.
        num_obstacles: Obstacles between start and goal; distractors do not count, shape (nworld,), int32.
        family: Kind of place, an index of `kinds.FAMILIES`, shape (nworld,), int32.
        way_m: Length of the shortest way from start to goal [m], 0 where nobody measured it, shape (nworld,).
        home, retreat, motion_speed, motion_trigger, motion_phase: How slots move, see `Scene`, shape (nworld,
            nslot), vec3, vec2 and float; `motion.py` draws them and moves the slots.
        moved: Way that moving slots went since the start [m], shape (nworld, nslot).
        nearby: Slots that physics and sensors know, shape (nworld, k), int32: all in their order where k is
            the number of slots, else those nearest to the robot (`warp_kernels.nearby`).
    """

    _PER_SLOT = (
        "pos",
        "yaw",
        "half_size",
        "active",
        "home",
        "retreat",
        "motion_speed",
        "motion_trigger",
        "motion_phase",
    )
    _PER_WORLD = (
        *_PER_SLOT,
        "start",
        "start_joints",
        "goal",
        "bend",
        "scenario",
        "difficulty",
        "num_obstacles",
        "family",
        "way_m",
    )

    def __init__(self, nworld: int, pool: PoolSpec, device: str, nearby: int | None = None) -> None:
        """Allocate empty scenes.

        Args:
            nworld: Number of worlds.
            pool: Slots of every world.
            device: Warp device.
            nearby: Most slots in `nearby`; None for all.
        """
        self.nworld = nworld
        self.pool = pool
        self.device = device
        shape = (nworld, pool.num_slots)
        kinds = Scene.empty(pool)
        with wp.ScopedDevice(device):
            self.pos = wp.zeros(shape, dtype=wp.vec3)
            self.yaw = wp.zeros(shape, dtype=float)
            self.half_size = wp.full(shape, wp.vec3(0.05, 0.05, 0.05), dtype=wp.vec3)
            self.active = wp.zeros(shape, dtype=bool)
            self.is_cylinder = wp.array(kinds.is_cylinder, dtype=bool)
            self.is_wall = wp.array(kinds.is_wall, dtype=bool)
            self.start = wp.zeros(nworld, dtype=wp.vec3)
            self.start_joints = wp.zeros((nworld, NUM_JOINTS), dtype=float)
            self.goal = wp.zeros(nworld, dtype=wp.vec2)
            self.bend = wp.zeros(nworld, dtype=wp.int32)
            self.scenario = wp.full(nworld, 1, dtype=wp.int32)
            self.difficulty = wp.zeros(nworld, dtype=wp.int32)
            self.num_obstacles = wp.zeros(nworld, dtype=wp.int32)
            self.family = wp.zeros(nworld, dtype=wp.int32)
            self.way_m = wp.zeros(nworld, dtype=float)
            self.home = wp.zeros(shape, dtype=wp.vec3)
            self.retreat = wp.zeros(shape, dtype=wp.vec2)
            self.motion_speed = wp.zeros(shape, dtype=float)
            self.motion_trigger = wp.zeros(shape, dtype=float)
            self.motion_phase = wp.zeros(shape, dtype=float)
            self.moved = wp.zeros(shape, dtype=float)
            known = min(pool.num_slots, nearby or pool.num_slots)
            self.nearby = wp.array(np.tile(np.arange(known), (nworld, 1)), dtype=wp.int32)

    def scene(self, world: int) -> Scene:
        """Copy one world to the host."""
        return self.scenes([world])[0]

    def scenes(self, worlds: list[int] | None = None) -> list[Scene]:
        """Copy worlds (all by default) to the host."""
        arrays = {name: getattr(self, name).numpy() for name in self._PER_WORLD}
        return [
            Scene(
                pool=self.pool,
                **{
                    name: value[w].astype(np.float64) if value.dtype.kind == "f" else value[w].copy()
                    for name, value in arrays.items()
                    if value.ndim > 1
                },
                **{name: value[w].item() for name, value in arrays.items() if value.ndim == 1},
            )
            for w in (range(self.nworld) if worlds is None else worlds)
        ]

    def load(self, scene: Scene, world: int | None = None) -> None:
        """Copy a host scene into one world, or into all of them; slots that the scene lacks become inactive.

        Args:
            scene: What to load.
            world: World index, or None for all worlds.

        Raises:
            ValueError: If the scene needs more slots of a kind than the layout has.
        """
        fitted = fit_to_pool(scene, self.pool)
        rows = slice(None) if world is None else world
        for name in self._PER_WORLD:
            array = getattr(self, name)
            values = array.numpy()
            values[rows] = getattr(fitted, name)
            array.assign(values)

    def load_each(self, scenes: Sequence[Scene]) -> None:
        """Copy a host scene into every world, see `load`; shape (nworld,)."""
        fitted = [fit_to_pool(scene, self.pool) for scene in scenes]
        for name in self._PER_WORLD:
            array = getattr(self, name)
            values = np.stack([getattr(scene, name) for scene in fitted])
            array.assign(values.astype(array.numpy().dtype))


def fit_to_pool(scene: Scene, pool: PoolSpec) -> Scene:
    """Return the same scene in the slots of another pool; itself, where that is its own.

    Raises:
        ValueError: The scene needs more slots of a kind than the pool has.
    """
    if scene.pool == pool:
        return scene
    fitted = Scene.empty(pool)
    for kind, first, fitted_first in (
        ("num_walls", 0, 0),
        ("num_boxes", scene.pool.first_box, pool.first_box),
        ("num_cylinders", scene.pool.first_cylinder, pool.first_cylinder),
    ):
        count = getattr(scene.pool, kind)
        if count > getattr(pool, kind):
            raise ValueError(f"the scene needs pool.{kind} = {count}, the pool has {getattr(pool, kind)}")
        for name in Layout._PER_SLOT:
            getattr(fitted, name)[fitted_first : fitted_first + count] = getattr(scene, name)[
                first : first + count
            ]
    for name in Layout._PER_WORLD[len(Layout._PER_SLOT) :]:
        setattr(fitted, name, getattr(scene, name))
    return fitted
