"""What a fetch knows of hand, object and surroundings beside the robot's state: groups that back ends tell.

A simulator tells the truth. A robot would have to measure it; from what, says `spin_rl.tasks.fetch.known`.
All is in the frame of the odometry, in which the corridor begins along +x with its middle at y = 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from spin_rl import robot
from spin_rl.deploy.fetch.numbers import GRIP_LEAD, HOLDS_N

GRIP, OBJECT_NOW, TABLE, OBSTACLES = "grip", "object_now", "table", "obstacles"
TOLD = (GRIP, OBJECT_NOW, TABLE, OBSTACLES)
"""Names of the groups, each of shape (1, size)."""
_COLUMNS = 8
_FINGER = robot.JOINTS.index("gripper_finger")


@dataclass(frozen=True)
class Grip:
    """Forces on the hand in the last step.

    Attributes:
        fingers_n: Of the left and of the right fingertip on the object [N].
        table_n: Of the fingers on the scene [N].
        hard_n: Of all other parts of the robot on the scene [N].
        is_supported: Whether the object stands on something.
    """

    fingers_n: tuple[float, float]
    table_n: float
    hard_n: float
    is_supported: bool

    @property
    def holds(self) -> bool:
        """Whether something hangs in the hand."""
        return sum(self.fingers_n) > HOLDS_N and not self.is_supported

    @property
    def stands(self) -> bool:
        """Whether what is held, or the hand, stands on something."""
        return self.is_supported or self.table_n > HOLDS_N


@dataclass(frozen=True)
class Slots:
    """Boxes and upright cylinders that stand around; `half` of a cylinder are radius, radius and half height.

    Attributes:
        pos: Centres [m], shape (n, 3).
        yaw: Their turn [rad], shape (n,).
        half: Half sizes [m], shape (n, 3).
        is_cylinder: Shape (n,), bool.
    """

    pos: np.ndarray
    yaw: np.ndarray
    half: np.ndarray
    is_cylinder: np.ndarray


@dataclass(frozen=True)
class Known:
    """All of it.

    Attributes:
        grip: Forces on the hand.
        object_at: The object's centre [m], shape (3,).
        object_speed: Its speed [m/s].
        is_seen: Whether the camera sees it.
        object_length: Length of its bounding box's half diagonal [m].
        table: The table, the only slot.
        near: Walls and obstacles, the table among them.
    """

    grip: Grip
    object_at: np.ndarray
    object_speed: float
    is_seen: bool
    object_length: float
    table: Slots
    near: Slots


@dataclass(frozen=True)
class Now:
    """What scripts and stages read in a step.

    Attributes:
        base: x, y [m], yaw [rad], shape (3,).
        turning: [rad/s].
        joints: Where they are, in `robot.JOINTS` order [m, rad], shape (8,).
        target: Their targets, as last commanded, shape (8,).
        known: What is told of hand, object and surroundings.
        period: Of control [s].
    """

    base: np.ndarray
    turning: float
    joints: np.ndarray
    target: np.ndarray
    known: Known
    period: float

    @property
    def grip(self) -> float:
        """Target of the fingers that keeps what they hold [rad]."""
        return float(self.joints[_FINGER]) - GRIP_LEAD


def tell(known: Known) -> dict[str, np.ndarray]:
    """Turn it into the groups `TOLD`, float32."""
    grip = known.grip
    groups = {
        GRIP: [*grip.fingers_n, grip.table_n, grip.hard_n, grip.is_supported],
        OBJECT_NOW: [*known.object_at, known.object_speed, known.is_seen, known.object_length],
        TABLE: _flat(known.table),
        OBSTACLES: _flat(known.near),
    }
    return {name: np.asarray(values, dtype=np.float32)[None] for name, values in groups.items()}


def read(told: Mapping[str, np.ndarray]) -> Known:
    """Read the groups `TOLD`."""
    left, right, table, hard, supported = told[GRIP][0].tolist()
    *at, speed, seen, length = told[OBJECT_NOW][0].tolist()
    return Known(
        grip=Grip((left, right), table, hard, bool(supported)),
        object_at=np.array(at),
        object_speed=speed,
        is_seen=bool(seen),
        object_length=length,
        table=_slots(told[TABLE]),
        near=_slots(told[OBSTACLES]),
    )


def _flat(slots: Slots) -> np.ndarray:
    columns = (slots.pos, slots.yaw[:, None], slots.half, slots.is_cylinder[:, None])
    return np.concatenate(columns, axis=1).ravel()


def _slots(group: np.ndarray) -> Slots:
    rows = group.reshape(-1, _COLUMNS).astype(float)
    return Slots(rows[:, :3], rows[:, 3], rows[:, 4:7], rows[:, 7] > 0.5)
