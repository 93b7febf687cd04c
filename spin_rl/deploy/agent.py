"""A policy with all that is between it and a robot: depth filter, observations, network, pilot, decoder."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from spin_rl import robot
from spin_rl.deploy import safety
from spin_rl.deploy.contract import Contract
from spin_rl.deploy.decoder import Decoder
from spin_rl.deploy.interface import Command, Connection, RobotState
from spin_rl.deploy.kinematics import Kinematics
from spin_rl.deploy.network import Network
from spin_rl.deploy.observations import Observer, Situation, as_pixels, in_base, out_of_base
from spin_rl.deploy.pilot.pilot import Pilot
from spin_rl.deploy.pilot.track import Track
from spin_rl.sensors.depth.robot import RobotDepthFilter, resample_depth, upright

ARRIVED = "arrived"
_CAMERA_ACTIONS = [robot.ACTIONS.index(joint) for joint in robot.CAMERA_JOINTS]


@dataclass(frozen=True)
class Inputs:
    """What the robot and its surroundings give in one step; with a file's policy it decides the action.

    Attributes:
        state: What the robot measures of itself.
        depth: The depth image as `Agent.reduce` returned it; None where neither policy nor pilot reads any.
        told: Observation groups that others compute, by name, each of shape (1, size).
        taken_s: When the image was taken, by the clock of the state's stamp [s]; None: with the state.
    """

    state: RobotState
    depth: np.ndarray | None = None
    told: Mapping[str, np.ndarray] = field(default_factory=dict)
    taken_s: float | None = None


class Agent:
    """Turns what a robot measures into commands, step by step.

    Attributes:
        contract: That of the policy.
        pilot: What drives along; None where the policy drives alone.
    """

    def __init__(self, network: Network, speed_scale: float = 1.0, *, pilot: bool = True) -> None:
        """Prepare everything.

        Args:
            network: The policy.
            speed_scale: See `Decoder`.
            pilot: False leaves the pilot out that the policy may have been trained with.
        """
        self.contract: Contract = network.contract
        self._network = network
        self._observer = Observer(self.contract)
        self._goal: np.ndarray | None = None
        self._decoder = Decoder(self.contract, speed_scale)
        self._kinematics = Kinematics()
        camera, config = self.contract.camera, self.contract.depth_filter
        self._filter: RobotDepthFilter | None = None
        if camera.image is not None and config is not None:
            self._filter = RobotDepthFilter(config, camera.image, mount=camera.mount)
        self.pilot = Pilot(self.contract, speed_scale) if pilot and self.contract.has_pilot else None
        self._track = Track()
        down, across = (math.tan(math.radians(fov) / 2) for fov in camera.fov_deg)
        self._tan_half_fov = (down, across)

    @property
    def reads_images(self) -> bool:
        """Whether policy or pilot read depth images."""
        return self._filter is not None or self.pilot is not None

    @property
    def target(self) -> np.ndarray:
        """Targets of the joints, as last commanded [m, rad], shape (8,)."""
        return self._decoder.target

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
        self.hold(state)
        self.aim(goal, None if object_start_b is None else out_of_base(object_start_b, state.base))
        if self.pilot is not None:
            assert goal is not None
            self.pilot.reset(state.base, goal)
            self._track = Track()

    def aim(self, goal: np.ndarray | None, object_start: np.ndarray | None) -> None:
        """Set goal and place of the object at the start, both in the frame of the odometry [m]."""
        self._goal, self._object = goal, object_start

    def hold(self, state: RobotState) -> None:
        """Take the action that holds the present pose for the last one."""
        self._last_action = self._with_fixed_camera(self._decoder.holding(state.joints))

    def reduce(self, image: np.ndarray) -> np.ndarray:
        """Turn a camera's own image upright and reduce it; see `resample_depth`."""
        camera = self.contract.camera
        assert camera.image is not None
        return resample_depth(upright(image, camera.mount), *camera.image)

    def observe(self, inputs: Inputs) -> dict[str, np.ndarray]:
        """Return the policy's groups, each of shape (1, size); once in a step: it takes in the image."""
        goal = self._goal
        if self.pilot is not None:
            assert inputs.depth is not None
            self._track.add(inputs.state)
            taken_s = inputs.state.stamp_s if inputs.taken_s is None else inputs.taken_s
            self.pilot.see(inputs.depth, *self._track.at(taken_s))
            goal = self.pilot.subgoal(inputs.state.base)
        now = Situation(
            state=inputs.state,
            frames=self._kinematics(inputs.state.joints),
            last_action=self._last_action,
            target=self._decoder.target,
            goal=goal,
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
        return self.follow(self.decide(inputs), inputs.state)

    def decide(self, inputs: Inputs) -> np.ndarray:
        """Return the network's action of one step, as the pilot lets it pass, shape (10,), not clipped."""
        action = self._with_fixed_camera(self._network(self.observe(inputs)))
        if self.pilot is None or not np.isfinite(action).all():
            return action
        return self.pilot.steer(action, inputs.state)

    def follow(self, action: np.ndarray, state: RobotState) -> tuple[np.ndarray, Command]:
        """Return an action as it is used, shape (10,), and its command.

        Raises:
            ValueError: It is not finite.
        """
        command = self._decoder(action, state.joints)
        self._last_action = np.clip(action, -1.0, 1.0)
        return self._last_action, command

    def take_over(self, other: Agent) -> None:
        """Go on from the commands of another policy, the memory empty; aims are as they were."""
        self._network.reset()
        if self._filter is not None:
            self._filter.reset()
        self._decoder.take_over(other._decoder)
        self._last_action = other._last_action

    def progress(self, inputs: Inputs) -> str | None:
        """Return `ARRIVED` once the goal is reached; called once before every step."""
        goal = self.contract.goal
        distance = self.distance_m(inputs.state)
        has_arrived = goal is not None and distance is not None and distance <= goal.tolerance_m
        return ARRIVED if has_arrived else None

    def distance_m(self, state: RobotState) -> float | None:
        """Return the distance from the base to the goal [m]; None without one."""
        return None if self._goal is None else float(np.hypot(*(self._goal - state.base[:2])))

    def check(self, connection: Connection, told: set[str]) -> None:
        """Reject a robot that cannot run it; see `safety.check_policy`."""
        safety.check_policy(self.contract, connection, told)

    def check_aims(self, goal: np.ndarray | None, object_b: np.ndarray | None) -> None:
        """Reject a run without what the policy is told; see `safety.check_aims`."""
        safety.check_aims(self.contract, goal, object_b)

    def _with_fixed_camera(self, action: np.ndarray) -> np.ndarray:
        pose = self.contract.camera.pose
        if pose is None:
            return action
        fixed = action.copy()
        fixed[_CAMERA_ACTIONS] = [
            robot.action_of(joint, value) for joint, value in zip(robot.CAMERA_JOINTS, pose, strict=True)
        ]
        return fixed
