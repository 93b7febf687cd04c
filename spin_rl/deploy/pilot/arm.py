"""The guard's part for the arm: it stands where its action would move it into what was seen.

As `tasks.nav.arm_guard`.
"""

from __future__ import annotations

import numpy as np

from spin_rl import robot
from spin_rl.deploy.contract import Contract
from spin_rl.deploy.kinematics import Kinematics
from spin_rl.deploy.pilot.body import Body, Hulls
from spin_rl.deploy.pilot.settings import FIRST_ARM_HULL

_AHEAD_S = 0.2
"""Time that the arm's actions are foreseen: the next step, and one for the arm to stand [s]."""
_IS_HEAD = np.array([joint in robot.CAMERA_JOINTS for joint in robot.JOINTS])
_ARM = slice(FIRST_ARM_HULL, None)


class ArmMotion:
    """Foresees what a policy's actions bring the arm into."""

    def __init__(self, contract: Contract, body: Body, kinematics: Kinematics) -> None:
        """Take what actions mean, and how fast the joints are."""
        actions = contract.actions
        self._low, self._zero, self._high = map(np.array, (actions.low, actions.zero, actions.high))
        self._most = _AHEAD_S * np.array(contract.speed_profile.joint_velocity_max)
        self._body, self._kinematics = body, kinematics

    def soon(self, now: Hulls, joints: np.ndarray, action: np.ndarray) -> Hulls:
        """Return the hulls with all that the arm will be in when an action was followed for 0.2 s.

        Args:
            now: The robot at its joints.
            joints: Where these are, in `robot.JOINTS` order [m, rad], shape (8,).
            action: Of the policy, shape (10,).
        """
        wanted = np.clip(action[2:], -1.0, 1.0)
        target = self._zero + wanted * np.where(
            wanted >= 0.0, self._high - self._zero, self._zero - self._low
        )
        moves = np.clip(target - joints, -self._most, self._most)
        moves[_IS_HEAD] = 0.0
        then = self._body.pose(self._kinematics.bodies(joints + moves)).hulls
        low, high = now.low.copy(), now.high.copy()
        low[_ARM], high[_ARM] = np.minimum(low, then.low)[_ARM], np.maximum(high, then.high)[_ARM]
        return Hulls(low, high)
