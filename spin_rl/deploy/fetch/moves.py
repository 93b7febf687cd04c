"""Single moves of which the scripts of a fetch are made; see `spin_rl.tasks.fetch.scripts.moves`."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from spin_rl import robot
from spin_rl.deploy.fetch import numbers as n

LIFT, ARM, YAW, PITCH, ROLL, FINGER, PAN, TILT = range(len(robot.JOINTS))
LIFT_MAX = robot.JOINT_UPPER[LIFT]
_PAN_MIN, _PAN_MAX = robot.JOINT_LOWER[PAN], robot.JOINT_UPPER[PAN]


@dataclass
class Wanted:
    """What a phase wants.

    Attributes:
        joints: Targets in `robot.JOINTS` order [m, rad], shape (8,).
        forward: Base speed [m/s].
        turn: Turning speed [rad/s].
        rate: Part of `numbers.RATES` at which targets move.
        done: Whether the phase is over.
    """

    joints: np.ndarray
    forward: float = 0.0
    turn: float = 0.0
    rate: float = 1.0
    done: bool = False


def clamp(value: float, low: float, high: float) -> float:
    """Return the nearest value in a range."""
    return min(max(value, low), high)


def wrapped(angle: float) -> float:
    """Return the same angle in [-pi, pi]."""
    return math.atan2(math.sin(angle), math.cos(angle))


def lift_of(grasp_z: float, down: float) -> float:
    """Return the lift [m] that puts the grasp centre at a height, the gripper pitched down by an angle."""
    return (
        grasp_z - robot.HAND_Z_M + robot.HAND_AHEAD_M * math.sin(down) + robot.HAND_BELOW_M * math.cos(down)
    )


def look(c: Wanted, base: np.ndarray, target: np.ndarray) -> None:
    """Turn the head to a target [m], shape (3,)."""
    cos, sin = math.cos(base[2]), math.sin(base[2])
    dx, dy = target[:2] - base[:2]
    ahead, left = cos * dx + sin * dy - robot.HEAD_X_M, cos * dy - sin * dx
    pan = math.atan2(left, ahead)
    if pan - _PAN_MAX > 2.0 * math.pi + _PAN_MIN - pan:  # nearer by the long way round to the right
        pan -= 2.0 * math.pi
    c.joints[PAN] = clamp(pan, _PAN_MIN, _PAN_MAX)
    c.joints[TILT] = -math.atan2(robot.HEAD_Z_M - target[2], math.hypot(ahead, left))


def fold(c: Wanted) -> None:
    """Fold the gripper back over the base."""
    c.joints[YAW], c.joints[PITCH] = robot.STOWED["wrist_yaw"], robot.STOWED["wrist_pitch"]
    c.joints[ROLL] = 0.0


def sweep(c: Wanted, steps: int, period: float) -> None:
    """Turn the head to and fro over its whole range, from straight ahead to the right."""
    span = _PAN_MAX - _PAN_MIN
    turn = math.fmod(steps * period * n.HEAD_SWEEP + _PAN_MAX, 2.0 * span)
    c.joints[PAN] = _PAN_MAX - turn if turn < span else _PAN_MAX - 2.0 * span + turn
    c.joints[TILT] = n.LOOK_TILT


def drive_to(c: Wanted, base: np.ndarray, point: np.ndarray) -> None:
    """Drive to a point [m], shape (2,), backwards if that is nearer."""
    dx, dy = point - base[:2]
    off = wrapped(math.atan2(dy, dx) - base[2])
    distance = math.hypot(dx, dy)
    c.done = distance < n.NEAR_M
    if not c.done:
        if abs(off) > 0.5 * math.pi:
            off = wrapped(off + math.pi)
            distance = -distance
        c.turn = clamp(2.0 * off, -1.0, 1.0)
        c.forward = max(1.0 - abs(off), 0.0) * clamp(1.5 * distance, -0.1, 0.2)
