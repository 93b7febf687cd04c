"""The pilot of a policy: it remembers what the depth camera saw, plans by it, and keeps the base from it."""

from __future__ import annotations

import math

import numpy as np

from spin_rl import robot
from spin_rl.config import ConfigError
from spin_rl.deploy.contract import Contract
from spin_rl.deploy.interface import RobotState
from spin_rl.deploy.kinematics import Frame, Kinematics
from spin_rl.deploy.pilot.arm import ArmMotion
from spin_rl.deploy.pilot.body import Body
from spin_rl.deploy.pilot.costmap import Costmap
from spin_rl.deploy.pilot.eye import Eye
from spin_rl.deploy.pilot.guard import filtered
from spin_rl.deploy.pilot.recovery import Recovery
from spin_rl.deploy.pilot.route import Route
from spin_rl.deploy.pilot.trial import Drive, Trial

_OWN_M = 0.04
"""What is seen so near to the robot's geoms is the robot."""
_CELL_M = 0.055
"""About how large a cell of the map of what was seen is [m]."""
_SIZE_M = 15.0
"""Side of that map where no planner has one [m]."""


class Pilot:
    """Drives along with one policy; once a tick `see`, then `subgoal`, then `steer`.

    Attributes:
        costmap: What was seen in this episode.
        route: The ways to the goal; None without a planner.
        is_guarded: Whether the last command was another than the policy's.
    """

    costmap: Costmap

    def __init__(self, contract: Contract, speed_scale: float = 1.0) -> None:
        """Prepare everything for a contract with a guard; see `Decoder` for `speed_scale`.

        Raises:
            ConfigError: The contract is of another robot.
        """
        assert contract.guard is not None
        self._contract, self._guard = contract, contract.guard
        self._planner = contract.planner if contract.has_planner else None
        self._eye, self._body = Eye(contract.camera), Body(contract.shapes)
        self._kinematics = Kinematics()
        bodies = self._kinematics.bodies(np.zeros(len(robot.JOINTS)))
        for shape in contract.shapes:
            if shape.body not in bodies:
                raise ConfigError(f"{contract.name}: shapes: the robot has no body {shape.body!r}")
        self._arm = ArmMotion(contract, self._body, self._kinematics)
        self._drive = Drive.of(contract, speed_scale)
        self._steps = max(round(self._guard.look_ahead_s / contract.period_s), 1)
        self.route: Route | None = None
        self._recovery: Recovery | None = None
        self.is_guarded = False

    def reset(self, base: np.ndarray, goal: np.ndarray) -> None:
        """Begin an episode with nothing seen.

        Args:
            base: Pose of the base in the frame of the odometry: x, y [m], yaw [rad].
            goal: Where to drive there [m], shape (2,).
        """
        period, place, planner = self._contract.period_s, base[:2].copy(), self._planner
        size, cell = _SIZE_M, _CELL_M
        if planner is not None:
            self.route = Route(planner, place, goal, period)
            self._recovery = Recovery(planner.stuck_s, period, place)
            parts = max(round(planner.cell_m / _CELL_M), 1)
            size, cell = planner.size_m, planner.cell_m / parts
        origin = 0.5 * (place + goal - size)
        self.costmap = Costmap(origin, size, cell, memory_s=self._guard.memory_s, period_s=period)
        self._goal, self.is_guarded = goal, False

    def see(self, depth: np.ndarray, joints: np.ndarray, base: np.ndarray) -> None:
        """Take in an image.

        Args:
            depth: Upright image of the policy's size [m], 0 where nothing was measured.
            joints: When it was taken, in `robot.JOINTS` order [m, rad], shape (8,).
            base: Pose of the base then, in the frame of the odometry, shape (3,).
        """
        bodies = self._kinematics.bodies(joints)
        camera = self._kinematics.sites(bodies)[robot.CAMERA_SITE]
        points = camera.to_base(np.concatenate([self._eye.points(depth), self._eye.rims(depth)]))
        points = points[~self._body.pose(bodies).holds(points, _OWN_M)]
        here = _base_frame(base)
        camera = Frame(here.to_base(camera.pos), here.mat @ camera.mat)
        self.costmap.see(self._eye, depth, camera, here.to_base(points))
        if self.route is not None:
            self.route.update(self.costmap, base[:2])

    def subgoal(self, base: np.ndarray) -> np.ndarray:
        """Return what to tell the policy for its goal, in the frame of the odometry [m], shape (2,)."""
        return self._goal if self.route is None else self.route.subgoal(base[:2])

    def steer(self, action: np.ndarray, state: RobotState) -> np.ndarray:
        """Return an action, shape (10,), in which base and arm hit nothing that was seen.

        Where the robot is stuck the pilot drives by itself. The arm keeps still then, since the policy does
        not know of it.
        """
        base, margin = state.base, self._guard.margin_m
        hulls = self._body.pose(self._kinematics.bodies(state.joints)).hulls
        trial = Trial(self.costmap, hulls, base, state.base_velocity, self._drive, margin)
        asked = self._drive.command_of(action[:2])
        command = filtered(asked, self._steps, trial)
        if trial.arm_goes_in(self._arm.soon(hulls, state.joints, action)):
            action = _with_arm_at(state.joints, action)
        self.is_guarded = command is not asked
        if self.route is not None and self._recovery is not None:
            way_out = self._recovery.update(base, self.is_guarded, trial, self.route.field)
            if way_out is not None:
                command, self.is_guarded = way_out, True
                action = _with_arm_at(state.joints, action)
        if not self.is_guarded:
            return action
        return np.concatenate([self._drive.action_of(command), action[2:]])


def _with_arm_at(joints: np.ndarray, action: np.ndarray) -> np.ndarray:
    held = action.copy()
    for index, (joint, value) in enumerate(zip(robot.JOINTS, joints.tolist(), strict=True), start=2):
        if joint not in robot.CAMERA_JOINTS:
            held[index] = np.clip(robot.action_of(joint, value), -1.0, 1.0)
    return held


def _base_frame(base: np.ndarray) -> Frame:
    """Return the base's frame in that of the odometry."""
    cos, sin = math.cos(base[2]), math.sin(base[2])
    return Frame(np.array([*base[:2], 0.0]), np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]))
