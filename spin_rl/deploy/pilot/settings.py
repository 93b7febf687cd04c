"""What of a policy's contract is about its pilot: guard, planner, and the shape of the robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from spin_rl.config import POSITIVE, Range

Positive = Annotated[float, POSITIVE]
NUM_HULLS = 4
"""Base; mast and head; arm; wrist and gripper."""
FIRST_ARM_HULL = 2


@dataclass(frozen=True)
class Guard:
    """What keeps the base from driving into what was seen; see `tasks.nav.config.GuardConfig`.

    Attributes:
        enabled: Whether the policy was trained behind one.
        look_ahead_s: Time that a command is tried for before it brakes [s].
        margin_m: Distance that counts as a collision [m].
        lag_s: Time constant that the base is expected to have [s].
        memory_s: Time after which what was not seen again is forgotten [s].
    """

    enabled: bool
    look_ahead_s: Annotated[float, Range(0.0, 2.0, above=True)]
    margin_m: Annotated[float, Range(0.0, 0.5)]
    lag_s: Positive
    memory_s: Positive


@dataclass(frozen=True)
class Planner:
    """What tells the policy points of the way for its goal; see `tasks.nav.config.PlannerConfig`.

    Attributes:
        enabled: Whether the policy was trained with one.
        ahead_m: How far along the way the point is [m].
        replan_s: Shortest time between plans [s].
        stuck_s: Time in one place after which the guard drives, if it keeps the robot from its commands [s].
        clearance_m: Nearer to obstacles a way costs 4 times its length [m].
        blocked_m: Nearer no way leads through [m].
        cell_m: Side of a cell of the ways' map [m].
        size_m: Side of that map [m].
    """

    enabled: bool
    ahead_m: Annotated[float, Range(0.3, 10.0)]
    replan_s: Positive
    stuck_s: Positive
    clearance_m: Annotated[float, Range(0.0, 2.0)]
    blocked_m: Annotated[float, Range(0.0, 1.0)]
    cell_m: Annotated[float, Range(0.02, 0.3)]
    size_m: Annotated[float, Range(2.0, 100.0)]


@dataclass(frozen=True)
class Shape:
    """A collision geom of the robot: a box with rounded edges, which as a capsule has one extent alone.

    Attributes:
        hull: The box around the robot that it is in, 0 to 3: base; mast and head; arm; wrist and gripper.
        body: The MJCF's body that it is on.
        pos: Its middle in the body's frame [m].
        quat: Its axes there, (w, x, y, z).
        half_size: Half extents along its axes [m].
        radius: Of the rounding [m].
    """

    hull: Annotated[int, Range(0, NUM_HULLS - 1)]
    body: str
    pos: tuple[float, float, float]
    quat: tuple[float, float, float, float]
    half_size: tuple[float, float, float]
    radius: Annotated[float, Range(0.0)]
