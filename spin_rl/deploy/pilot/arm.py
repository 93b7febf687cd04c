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
"""Time that the arm's actions are foreseen [s]."""
_HEAD = [joint in robot.CAMERA_JOINTS for joint in robot.JOINTS]


class ArmGuard:
    """Foresees where a policy's actions bring the arm."""

    def __init__(self, contract: Contract, body: Body, kinematics: Kinematics) -> None:
        """Take the joints' speeds of a contract."""
        self._most = _AHEAD_S * np.array(contract.speed_profile.joint_velocity_max)
        self._body, self._kinematics = body, kinematics

    def soon(self, now: Hulls, joints: np.ndarray, action: np.ndarray) -> Hulls:
        """Return the hulls with what the arm will be in after 0.2 s of an action.

        Args:
            now: The robot at its joints.
            joints: These, in `robot.JOINTS` order [m, rad], shape (8,).
            action: Of the policy, shape (10,).
        """
        targets = [robot.joint_of(name, a) for name, a in zip(robot.JOINTS, np.clip(action[2:], -1.0, 1.0), strict=True)]
        moves = np.clip(np.array(targets) - joints, -self._most, self._most)
        moves[_HEAD] = 0.0
        then = self._body.pose(self._kinematics.bodies(joints + moves)).hulls
        low, high = now.low.copy(), now.high.copy()
        arm = slice(FIRST_ARM_HULL, None)
        low[arm], high[arm] = np.minimum(low, then.low)[arm], np.maximum(high, then.high)[arm]
        return Hulls(low, high)
