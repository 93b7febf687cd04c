"""An episode over time, and where the robot is in it relative to the obstacles."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from spin_rl import robot
from spin_rl.scenes import kinds
from spin_rl.scenes.layout import Scene
from spin_rl.scenes.outline import distance_to, outline

AHEAD_M = 1.5
"""How far ahead of the base something is in the way."""
_STRIP_M = 0.22  # half the width of what the base drives over, with 4 cm to spare
_STRIP_STEP_M = 0.1
FAR_M = 10.0
"""Stands for the distance to what is not there."""


@dataclass(frozen=True)
class DriveTrace:
    """One episode at its observations; the last one is the last before the end.

    Attributes:
        condition: Cell, family or scene of the benchmark.
        seed: Of the benchmark.
        world: Number in the seed's batch.
        outcome: How it ended, such as "success".
        period: Time between two observations [s].
        scene: Its scene; positions of moving slots are in `slot_pos`.
        qpos: State of the robot in `robot.DOF_NAMES` order [m, rad], shape (n, 13).
        hand: Grasp centre, world [m], shape (n, 3).
        slot_pos: Positions of the slots [m], shape (n, nslot, 3).
        seen: Of which slots the camera showed a corner, shape (n, nslot), bool.
        hits: Part of the robot and slot, the nearest first, where it ended by a collision.
    """

    condition: str
    seed: int
    world: int
    outcome: str
    period: float
    scene: Scene
    qpos: np.ndarray
    hand: np.ndarray
    slot_pos: np.ndarray
    seen: np.ndarray
    hits: tuple[tuple[str, int], ...] = ()

    @property
    def steps(self) -> int:
        """Number of observations."""
        return len(self.qpos)

    def joint(self, name: str) -> np.ndarray:
        """Position of a degree of freedom [m or rad], shape (n,)."""
        return self.qpos[:, robot.DOF_NAMES.index(name)]

    @cached_property
    def obstacles(self) -> list[int]:
        """Slots that are there and no walls."""
        return np.flatnonzero(self.scene.active & ~self.scene.is_wall).tolist()

    @cached_property
    def level(self) -> list[str]:
        """Level of every slot, see `kinds.LEVELS`."""
        return kinds.levels(self.scene)

    @cached_property
    def speed(self) -> np.ndarray:
        """Speed of the base over the floor up to the next observation [m/s], shape (n,)."""
        steps = np.linalg.norm(np.diff(self.qpos[:, :2], axis=0), axis=1) / self.period
        return np.append(steps, steps[-1:] if len(steps) else 0.0)

    def moves(self, slot: int) -> np.ndarray:
        """Speed of a slot up to an observation [m/s], shape (n,)."""
        steps = np.linalg.norm(np.diff(self.slot_pos[:, slot, :2], axis=0), axis=1) / self.period
        return np.insert(steps, 0, 0.0)

    def distance(self, slot: int, points: np.ndarray) -> np.ndarray:
        """Distance of points to the footprint of a slot, which may move [m].

        Args:
            slot: The slot.
            points: Positions [m], shape (n, 2) or (n, k, 2).

        Returns:
            0 inside, shape (n,) or (n, k).
        """
        origin = replace(self.scene, pos=np.zeros_like(self.scene.pos))
        moved = self.slot_pos[:, slot, :2]
        offset = points - (moved if points.ndim == 2 else moved[:, None])
        return distance_to(outline(origin, slot), offset.reshape(-1, 2)).reshape(offset.shape[:-1])

    def nearest(self, slots: list[int]) -> tuple[np.ndarray, np.ndarray]:
        """Distance of the base's origin to the nearest of some slots, and which it is.

        Returns:
            Distances [m], at most `FAR_M`, and slots, -1 for none, shape (n,) each.
        """
        if not slots:
            return np.full(self.steps, FAR_M), np.full(self.steps, -1)
        distances = np.stack([self.distance(slot, self.qpos[:, :2]) for slot in slots])
        index = distances.argmin(0)
        return np.minimum(distances.min(0), FAR_M), np.array(slots)[index]

    def in_way(self, slot: int) -> np.ndarray:
        """Whether the base would drive into a slot within `AHEAD_M` if it went straight on, (n,), bool."""
        front = robot.BASE_X_M[1]
        ahead = np.arange(front, AHEAD_M, _STRIP_STEP_M)
        yaw = self.qpos[:, 2]
        heading = np.stack([np.cos(yaw), np.sin(yaw)], -1)
        points = self.qpos[:, None, :2] + ahead[:, None] * heading[:, None]
        return self.distance(slot, points).min(1) <= _STRIP_M

    def bearing(self, slots: np.ndarray) -> np.ndarray:
        """Direction of a slot of every observation from the base [rad], positive to the left, shape (n,)."""
        to = self.slot_pos[np.arange(self.steps), slots, :2] - self.qpos[:, :2]
        return wrapped(np.arctan2(to[:, 1], to[:, 0]) - self.qpos[:, 2])

    def height_of(self, slot: int) -> tuple[float, float]:
        """Bottom and top of a slot [m]."""
        middle, half = float(self.scene.pos[slot, 2]), float(self.scene.half_size[slot, 2])
        return middle - half, middle + half


def wrapped(angle: np.ndarray) -> np.ndarray:
    """Angles [rad] within -pi to pi."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi
