"""From actions to commands: targets as in training, with caps on speed, acceleration and joints."""

from __future__ import annotations

import numpy as np

from spin_rl import robot
from spin_rl.deploy.contract import ABSOLUTE, Contract
from spin_rl.deploy.interface import Command

_FINGER = robot.JOINTS.index("gripper_finger")


class Decoder:
    """Turns the actions of one policy into commands that a robot may follow.

    Attributes:
        target: Targets of the joints, as last commanded [m, rad], shape (8,).
    """

    def __init__(self, contract: Contract, speed_scale: float = 1.0) -> None:
        """Take the limits of the training.

        Args:
            contract: Says what actions mean, and how fast the robot was.
            speed_scale: Factor on all speeds of base and joints, above 0 and at most 1.

        Raises:
            ValueError: It is not.
        """
        if not 0.0 < speed_scale <= 1.0:
            raise ValueError(f"speed_scale must be above 0 and at most 1, got {speed_scale}")
        self._actions = actions = contract.actions
        self._period, self._scale = contract.period_s, speed_scale
        self._low, self._zero, self._high = map(np.array, (actions.low, actions.zero, actions.high))
        self._rate, self._lead = np.array(actions.joint_rate), np.array(actions.joint_lead)
        profile = contract.speed_profile
        self._base_step = np.array([profile.base_acceleration, profile.turn_acceleration]) * self._period
        self._joint_speed = speed_scale * np.array(profile.joint_velocity_max)
        self._base = np.zeros(2)
        self.target = self._zero.copy()

    def reset(self, joints: np.ndarray) -> None:
        """Start at rest, with the joints' positions [m, rad], shape (8,), as their targets."""
        self._base = np.zeros(2)
        self.target = np.clip(joints, self._low, self._high)

    def take_over(self, other: Decoder) -> None:
        """Go on from another policy's speeds and targets."""
        self._base, self.target = other._base, other.target.copy()

    def holding(self, joints: np.ndarray) -> np.ndarray:
        """Return the action that holds a pose [m, rad], shape (8,), standing; shape (10,)."""
        action = np.zeros(len(robot.ACTIONS))
        if self._actions.mode == ABSOLUTE:
            offset = np.clip(joints, self._low, self._high) - self._zero
            span = np.where(offset >= 0.0, self._high - self._zero, self._zero - self._low)
            action[2:] = offset / np.maximum(span, 1e-6)
        else:
            hold = (joints[_FINGER] - self._actions.gripper_middle) / self._actions.gripper_span
            action[2 + _FINGER] = hold
        return np.clip(action, -1.0, 1.0)

    def __call__(self, action: np.ndarray, joints: np.ndarray) -> Command:
        """Decode an action.

        Args:
            action: In [-1, 1] (clipped), `robot.ACTIONS` order, shape (10,).
            joints: Where the joints are [m, rad], shape (8,).

        Raises:
            ValueError: The action is not finite.
        """
        if not np.isfinite(action).all():
            raise ValueError("the action is not finite")
        action = np.clip(action, -1.0, 1.0)
        self._base = self._next_base(action[:2])
        self.target = self._next_target(action[2:], joints)
        return Command(*self._base.tolist(), joints=self.target.copy(), joint_speed=self._joint_speed.copy())

    def _next_base(self, action: np.ndarray) -> np.ndarray:
        """Return the speeds that come next: those of the action, without a jump from the last ones."""
        ahead, back = self._actions.forward
        most = np.array([ahead if action[0] >= 0.0 else back, self._actions.turn])
        wanted = self._scale * most * action
        return self._base + np.clip(wanted - self._base, -self._base_step, self._base_step)

    def _next_target(self, action: np.ndarray, joints: np.ndarray) -> np.ndarray:
        if self._actions.mode == ABSOLUTE:
            span = np.where(action >= 0.0, self._high - self._zero, self._zero - self._low)
            target = self._zero + action * span
        else:
            target = self.target + action * self._rate * self._period
            grip = self._actions.gripper_middle + action[_FINGER] * self._actions.gripper_span
            target[_FINGER] = grip
            target = np.clip(target, joints - self._lead, joints + self._lead)
        return np.clip(target, self._low, self._high)
