"""The observation groups of a policy, from what a robot measures.

The raw values of every term are computed here, in the robot's units; how they are scaled is in the policy's
file. Together they are what `tasks.common.formulas` gives in training: a test holds the two together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from spin_rl import robot
from spin_rl.config import ConfigError
from spin_rl.deploy.contract import UINT8, Contract, Group
from spin_rl.deploy.interface import RobotState
from spin_rl.deploy.kinematics import Frame

_FINGER = robot.JOINTS.index("gripper_finger")
NEAR_PER_M, CLOSE_PER_M = 5.0, 20.0
"""Units in which an object's offset from the hand is told, clipped to 1: 0.2 m and 0.05 m."""
_NEAREST_M = 0.05
"""Points nearer than this to the camera, or behind it, are located as if they were here."""


@dataclass(frozen=True)
class Situation:
    """All that terms are computed from.

    Attributes:
        state: What the robot measures.
        frames: Frames of the robot's sites in the base, by its joints.
        last_action: In [-1, 1], as it was sent, shape (10,).
        target: Targets of the joints, as last commanded [m, rad], shape (8,).
        goal: Where to drive in the frame of the odometry [m], shape (2,); None without one.
        object_start_b: Where the object was at the start, in the base frame now [m], shape (3,).
        tan_half_fov: Tangents of half the camera's field of view, up and down, and across.
        goal_range_m: See `contract.Goal`.
    """

    state: RobotState
    frames: Mapping[str, Frame]
    last_action: np.ndarray
    target: np.ndarray
    goal: np.ndarray | None
    object_start_b: np.ndarray | None
    tan_half_fov: tuple[float, float]
    goal_range_m: float | None

    @property
    def hand(self) -> Frame:
        """The grasp centre: x out of the gripper, y from finger to finger."""
        return self.frames[robot.GRASP_CENTER_SITE]


def in_base(point: np.ndarray, base: np.ndarray) -> np.ndarray:
    """Turn a point of the odometry's frame [m], shape (2,) or (3,), into the frame of a base pose."""
    dx, dy = point[:2] - base[:2]
    cos, sin = math.cos(base[2]), math.sin(base[2])
    return np.array([cos * dx + sin * dy, cos * dy - sin * dx, *point[2:]])


def seen_object(at: np.ndarray, base: np.ndarray, hand: np.ndarray, gripper: np.ndarray) -> np.ndarray:
    """Return the group `object` of an object in sight, shape (10,); out of sight it is 0.

    Args:
        at: Where it is [m], shape (3,).
        base: x, y [m], yaw [rad], in the same frame, shape (3,).
        hand: The grasp centre [m], likewise, shape (3,).
        gripper: Its axes as columns, shape (3, 3).
    """
    offset = gripper.T @ (at - hand)
    near, close = (np.clip(scale * offset, -1.0, 1.0) for scale in (NEAR_PER_M, CLOSE_PER_M))
    return np.concatenate([[1.0], in_base(at, base), near, close])


def out_of_base(point_b: np.ndarray, base: np.ndarray) -> np.ndarray:
    """Turn a point of a base pose's frame [m], shape (3,), into the frame of the odometry."""
    back = np.array([0.0, 0.0, -base[2]])
    return in_base(point_b, back) + np.array([*base[:2], 0.0])


def _goal(now: Situation) -> np.ndarray:
    """Return the goal in the base frame, x, y and distance [m], no farther than the policy knows."""
    assert now.goal is not None
    goal_b = in_base(now.goal, now.state.base)
    distance = float(np.hypot(*goal_b))
    if now.goal_range_m is not None and distance > now.goal_range_m:
        goal_b, distance = goal_b * (now.goal_range_m / distance), now.goal_range_m
    return np.array([*goal_b, distance])


def _object_start(now: Situation) -> np.ndarray:
    assert now.object_start_b is not None
    return now.object_start_b


def _from_hand(now: Situation) -> np.ndarray:
    """Return where the object was at the start from the grasp centre, in the gripper's axes [m]."""
    return now.hand.mat.T @ (_object_start(now) - now.hand.pos)


def _in_camera(now: Situation) -> np.ndarray:
    """Return the grasp centre in the optical frame: x down, y to the left, z ahead [m]."""
    camera = now.frames[robot.CAMERA_SITE]
    return camera.mat.T @ (now.hand.pos - camera.pos)


def _hand_pixel(now: Situation) -> np.ndarray:
    x, y, z = _in_camera(now)
    ahead = max(z, _NEAREST_M)
    return np.array([-y / (ahead * now.tan_half_fov[1]), x / (ahead * now.tan_half_fov[0])])


TERMS: Mapping[str, Callable[[Situation], np.ndarray]] = {
    "joint_position": lambda now: now.state.joints,
    "joint_velocity": lambda now: now.state.joint_velocity,
    "base_velocity": lambda now: now.state.base_velocity,
    "end_effector": lambda now: now.hand.pos,
    "last_action": lambda now: now.last_action,
    "goal": _goal,
    "hand_axes": lambda now: np.concatenate([now.hand.mat[:, 0], now.hand.mat[:, 2]]),
    "grip": lambda now: now.target[_FINGER : _FINGER + 1] - now.state.joints[_FINGER : _FINGER + 1],
    "object_start": _object_start,
    "object_is_told": lambda now: np.ones(1),
    "object_start_near": _from_hand,
    "object_start_close": _from_hand,
    "hand_pixel": _hand_pixel,
    "hand_depth": lambda now: _in_camera(now)[2:],
}
"""Raw values of every term, shape (columns,), by its name."""


class Observer:
    """Computes the observation groups of a policy."""

    def __init__(self, contract: Contract) -> None:
        """Prepare the scaling.

        Raises:
            ConfigError: The policy reads a term that this version does not know.
        """
        self._computed = [group for group in contract.observations if group.terms]
        for term in (term for group in self._computed for term in group.terms):
            if term.name not in TERMS:
                raise ConfigError(f"{contract.name}: this version does not know what {term.name!r} is")
        self._scales = {
            (group.name, term.name): (np.array(term.scale), np.array(term.bias), term.clip)
            for group in self._computed
            for term in group.terms
        }

    def __call__(self, now: Situation) -> dict[str, np.ndarray]:
        """Return all groups with terms, each of shape (1, size), float32."""
        return {group.name: self._group(group, now) for group in self._computed}

    def _group(self, group: Group, now: Situation) -> np.ndarray:
        values = []
        for term in group.terms:
            scale, bias, clip = self._scales[group.name, term.name]
            value = TERMS[term.name](now) * scale + bias
            values.append(value if clip is None else np.clip(value, -clip, clip))
        return np.concatenate(values, dtype=np.float32)[None]


def as_pixels(image: np.ndarray) -> np.ndarray:
    """Turn a filtered image in [0, 1] into the input of a network, 0 to 255, shape (1, pixels), uint8."""
    return (image.reshape(1, -1) * 255.0 + 0.5).astype(UINT8)
