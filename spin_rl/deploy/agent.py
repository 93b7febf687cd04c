"""A policy with all that is between it and a robot: depth filter, observations, network, decoder."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from spin_rl import robot
from spin_rl.deploy.contract import Contract
from spin_rl.deploy.decoder import Decoder
from spin_rl.deploy.interface import Command, RobotState
from spin_rl.deploy.kinematics import Kinematics
from spin_rl.deploy.network import Network
from spin_rl.deploy.observations import Observer, Situation, as_pixels, in_base
from spin_rl.sensors.depth.robot import RobotDepthFilter

_CAMERA_ACTIONS = [robot.ACTIONS.index(joint) for joint in robot.CAMERA_JOINTS]


@dataclass(frozen=True)
class Inputs:
    """What the robot and its surroundings give in one step; with a file's policy it decides the action.

    Attributes:
        state: What the robot measures of itself.
        depth: The depth image as `Agent.reduce` returned it; None for a policy that reads none.
        told: Observation groups that others compute, by name, each of shape (1, size).
    """

    state: RobotState
    depth: np.ndarray | None = None
    told: Mapping[str, np.ndarray] = field(default_factory=dict)


class Agent:
    """Turns what a robot measures into commands, step by step.

    Attributes:
        contract: That of the policy.
    """

    def __init__(self, network: Network, speed_scale: float = 1.0) -> None:
        """Prepare everything; see `Decoder` for `speed_scale`."""
        self.contract: Contract = network.contract
        self._network = network
        self._observer = Observer(self.contract)
        self._decoder = Decoder(self.contract, speed_scale)
        self._kinematics = Kinematics()
        camera, config = self.contract.camera, self.contract.depth_filter
        self._filter: RobotDepthFilter | None = None
        if camera.image is not None and config is not None:
            self._filter = RobotDepthFilter(config, camera.image, mount=camera.mount)
        down, across = (math.tan(math.radians(fov) / 2) for fov in camera.fov_deg)
        self._tan_half_fov = (down, across)

    @property
    def reads_images(self) -> bool:
        """Whether the policy reads depth images."""
        return self._filter is not None

    def reset(
        self, state: RobotState, goal: np.ndarray | None = None, object_start_b: np.ndarray | None = None
    ) -> None:
        """Start an episode: forget everything, hold the present pose.

        Args:
            state: What the robot measures now.
            goal: Where to drive in the frame of the odometry [m], shape (2,).
            object_start_b: Where the object is now, in the base frame [m], shape (3,).
        """
        self._network.reset()
        self._decoder.reset(state.joints)
        if self._filter is not None:
            self._filter.reset()
        self._last_action = self._with_fixed_camera(self._decoder.holding(state.joints))
        self._goal = goal
        self._object = None
        if object_start_b is not None:
            # Kept in the frame of the odometry, in which it stays where it is.
            back = np.array([0.0, 0.0, -state.base[2]])
            self._object = in_base(object_start_b, back) + np.array([*state.base[:2], 0.0])

    def reduce(self, image: np.ndarray) -> np.ndarray:
        """Turn a camera's own image upright and reduce it; see `RobotDepthFilter.reduce`."""
        assert self._filter is not None
        return self._filter.reduce(image)

    def observe(self, inputs: Inputs) -> dict[str, np.ndarray]:
        """Return the policy's groups, each of shape (1, size); once in a step, since it filters the image."""
        now = Situation(
            state=inputs.state,
            frames=self._kinematics(inputs.state.joints),
            last_action=self._last_action,
            target=self._decoder.target,
            goal=self._goal,
            object_start_b=None if self._object is None else in_base(self._object, inputs.state.base),
            tan_half_fov=self._tan_half_fov,
            goal_range_m=None if self.contract.goal is None else self.contract.goal.range_m,
        )
        groups = {**inputs.told, **self._observer(now)}
        if self._filter is not None:
            assert inputs.depth is not None
            groups["depth"] = as_pixels(self._filter.update(inputs.depth))
        return groups

    def act(self, inputs: Inputs) -> tuple[np.ndarray, Command]:
        """Return the action of one step as it was used, shape (10,), and its command.

        Raises:
            ValueError: The network's output is not finite.
        """
        action = self._network(self.observe(inputs))
        command_of = self._with_fixed_camera(action)
        command = self._decoder(command_of, inputs.state.joints)
        self._last_action = np.clip(command_of, -1.0, 1.0)
        return self._last_action, command

    def _with_fixed_camera(self, action: np.ndarray) -> np.ndarray:
        pose = self.contract.camera.pose
        if pose is None:
            return action
        fixed = action.copy()
        fixed[_CAMERA_ACTIONS] = [
            robot.action_of(joint, value) for joint, value in zip(robot.CAMERA_JOINTS, pose, strict=True)
        ]
        return fixed
