# pyright: reportMissingImports=false
# (ROS 2 is no Python package that could be installed)
"""A Stretch behind Hello Robot's ROS 2 driver: all calls of rclpy. Never tried on a robot.

Written from the interface of the driver `stretch_core/stretch_driver` for Humble and its launch files.
Speeds of the base go to `cmd_vel`, which counts in the driver's navigation mode alone and for half a second;
joints to `joint_pose_cmd`, whose order is `_POSE`. The driver's topics come at 30 Hz; what came last is kept.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from spin_rl import robot
from spin_rl.config import ConfigError, from_mapping
from spin_rl.deploy.backends.dry_run import DryRun
from spin_rl.deploy.backends.ros_messages import metres, seconds
from spin_rl.deploy.clock import MonotonicClock
from spin_rl.deploy.contract import Contract
from spin_rl.deploy.interface import (
    CameraInfo,
    Clock,
    Command,
    Connection,
    DepthFrame,
    DeviceLost,
    Robot,
    RobotState,
)

_POSE = (
    "arm_extension",
    "lift",
    "wrist_yaw",
    "wrist_pitch",
    "wrist_roll",
    "head_pan",
    "head_tilt",
    "gripper_finger",
)
"""Joints in the order of `joint_pose_cmd`; moves of the base follow, which are 0 in the navigation mode."""
_NAMES: Mapping[str, str] = {
    "lift": "joint_lift",
    "arm_extension": "wrist_extension",
    "gripper_finger": "joint_gripper_finger_left",
    **{name: f"joint_{name}" for name in _POSE[2:7]},
}
"""Names of joints in `joint_states`."""
_NAVIGATION, _RUNSTOPPED = "navigation", "runstopped"
_SERVICES = ("switch_to_navigation_mode", "activate_streaming_position")
_FINGER = robot.JOINTS.index("gripper_finger")
_ANSWER_S = 5.0
_LONGEST_S = 0.2
"""Longest time between two commands that joints are led ahead for."""


@dataclass(frozen=True)
class Settings:
    """Settings of the back end, `robot.<key>=<value>` on the command line.

    Attributes:
        dry_run: Whether commands are printed and nothing moves.
        cmd_vel: Topic of the base's speeds, `joint_states`, `odom` and the others likewise.
        depth: Topic of the depth image; `camera_info` is beside it.
    """

    dry_run: bool = False
    cmd_vel: str = "/stretch/cmd_vel"
    joint_states: str = "/stretch/joint_states"
    joint_pose_cmd: str = "/joint_pose_cmd"
    odom: str = "/odom"
    mode: str = "/mode"
    is_homed: str = "/is_homed"
    is_runstopped: str = "/is_runstopped"
    depth: str = "/camera/depth/image_rect_raw"
    camera_info: str = "/camera/depth/camera_info"


def open_robot(settings: Mapping[str, Any], contract: Contract) -> Robot:
    """Make the robot; see `backends`.

    Raises:
        ConfigError: A setting is wrong.
        ImportError: There is no ROS 2 here.
    """
    cfg = from_mapping(Settings, settings, "robot")
    opened = RosRobot(cfg, reads_images=contract.camera.image is not None)
    return DryRun(opened) if cfg.dry_run else opened


class RosRobot:
    """The robot as a node; a `Robot`.

    Attributes:
        clock: The computer's; stamps of messages are turned into it by how old they are when they come.
    """

    def __init__(self, cfg: Settings, *, reads_images: bool) -> None:
        """Import ROS 2; nothing is started yet."""
        import geometry_msgs.msg
        import nav_msgs.msg
        import rclpy
        import sensor_msgs.msg
        import std_msgs.msg
        import std_srvs.srv
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.qos import qos_profile_sensor_data
        from rclpy.signals import SignalHandlerOptions

        self.clock: Clock = MonotonicClock()
        self._cfg, self._rclpy, self._executor_of = cfg, rclpy, SingleThreadedExecutor
        self._no_signals, self._any_quality = SignalHandlerOptions.NO, qos_profile_sensor_data
        self._twist, self._array = geometry_msgs.msg.Twist, std_msgs.msg.Float64MultiArray
        self._trigger = std_srvs.srv.Trigger
        self._topics: dict[str, Any] = {
            "odom": nav_msgs.msg.Odometry,
            "joint_states": sensor_msgs.msg.JointState,
            "mode": std_msgs.msg.String,
            "is_homed": std_msgs.msg.Bool,
            "is_runstopped": std_msgs.msg.Bool,
        }
        if reads_images:
            images = {"depth": sensor_msgs.msg.Image, "camera_info": sensor_msgs.msg.CameraInfo}
            self._topics |= images
        self._latest: dict[str, Any] = {}
        self._stamps: dict[str, float] = {}
        self._finger_velocity = 0.0
        self._node: Any = None
        self._pose: np.ndarray | None = None
        self._sent_s = 0.0

    def connect(self) -> Connection:
        """Join the graph, wait for every topic, and switch to the mode in which the base follows speeds.

        Raises:
            ConfigError: A topic or a service is missing, or the driver refuses.
        """
        # Ctrl-C must not shut ROS down before the robot was told to stand.
        self._rclpy.init(signal_handler_options=self._no_signals)
        self._node = node = self._rclpy.create_node("spin_deploy")
        for topic, kind in self._topics.items():
            node.create_subscription(kind, getattr(self._cfg, topic), self._keep(topic), self._any_quality)
        self._speeds = node.create_publisher(self._twist, self._cfg.cmd_vel, 1)
        self._targets = node.create_publisher(self._array, self._cfg.joint_pose_cmd, 1)
        self._executor = self._executor_of()
        self._executor.add_node(node)
        threading.Thread(target=self._executor.spin, daemon=True).start()
        self._await(lambda: len(self._latest) == len(self._topics))
        for topic in self._topics:
            if topic not in self._latest:
                raise ConfigError(f"robot.{topic}: nothing comes from {getattr(self._cfg, topic)}")
        missing = sorted(set(_NAMES.values()) - set(self._latest["joint_states"].name))
        if missing:
            raise ConfigError(f"robot.joint_states: no {missing[0]!r}; policies need the dexterous wrist")
        for service in _SERVICES:
            self._call(service)
        self._await(lambda: self._latest["mode"].data == _NAVIGATION)
        camera = self._camera() if "depth" in self._topics else None
        return Connection(is_real=True, camera=camera)

    def state(self) -> RobotState:
        """Return the latest state, as old as the older one of joints and odometry.

        Raises:
            DeviceLost: The driver has left the navigation mode, in which alone the base follows speeds.
        """
        odom, mode = self._latest["odom"], self._latest["mode"].data
        if mode not in (_NAVIGATION, _RUNSTOPPED):
            raise DeviceLost(f"the driver is in the mode {mode!r}")
        pose, twist = odom.pose.pose, odom.twist.twist
        turn = pose.orientation
        yaw = math.atan2(
            2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y * turn.y + turn.z * turn.z)
        )
        velocity = self._joints("velocity")
        velocity[_FINGER] = self._finger_velocity
        return RobotState(
            stamp_s=min(self._stamps["odom"], self._stamps["joint_states"]),
            joints=self._joints("position"),
            joint_velocity=velocity,
            base=np.array([pose.position.x, pose.position.y, yaw]),
            base_velocity=np.array([twist.linear.x, twist.angular.z]),
            homed=self._latest["is_homed"].data,
            runstop=self._latest["is_runstopped"].data or mode == _RUNSTOPPED,
        )

    def depth(self) -> DepthFrame | None:
        """Return the latest image."""
        message = self._latest.get("depth")
        return None if message is None else DepthFrame(self._stamps["depth"], metres(message))

    def command(self, command: Command) -> None:
        """Publish speeds and targets; the driver knows no speeds of joints, so targets move at them."""
        now_s = self.clock.now()
        if self._pose is None:
            self._pose = self._joints("position")
        lead = command.joint_speed * min(now_s - self._sent_s, _LONGEST_S)
        self._pose = self._pose + np.clip(command.joints - self._pose, -lead, lead)
        self._sent_s = now_s
        self._move(command.forward, command.turn)
        self._hold(self._pose)

    def stop(self) -> None:
        """Stand, then hold the joints; the fingers keep their target, or they would lose what they hold."""
        if self._node is None:
            return
        self._move(0.0, 0.0)
        if self._pose is not None:
            held = self._joints("position")
            held[_FINGER] = self._pose[_FINGER]
            self._hold(held)

    def close(self) -> None:
        """Leave the graph; without speeds the driver stands by itself."""
        if self._node is not None:
            self._executor.shutdown()
            self._node.destroy_node()
            self._rclpy.shutdown()
            self._node = None

    def told(self) -> Mapping[str, np.ndarray]:
        """Return nothing: there is no detector."""
        return {}

    def _joints(self, what: str) -> np.ndarray:
        """Return positions or velocities in `robot.JOINTS` order, shape (8,)."""
        message = self._latest["joint_states"]
        values = dict(zip(message.name, getattr(message, what), strict=True))
        return np.array([values[_NAMES[name]] for name in robot.JOINTS])

    def _keep(self, topic: str) -> Any:
        def keep(message: Any) -> None:
            if topic == "joint_states":
                self._finger_velocity = self._velocity_of_fingers(message)
            if hasattr(message, "header"):
                self._stamps[topic] = self._arrived_s(message)
            self._latest[topic] = message

        return keep

    def _velocity_of_fingers(self, message: Any) -> float:
        """Return how fast the fingers open [rad/s]; what the driver tells is no speed of theirs."""
        before = self._latest.get("joint_states")
        if before is None or (passed_s := seconds(message) - seconds(before)) <= 0.0:
            return self._finger_velocity
        now, then = (
            dict(zip(m.name, m.position, strict=False)).get(_NAMES["gripper_finger"], 0.0)
            for m in (message, before)
        )
        return (now - then) / passed_s

    def _await(self, is_met: Any) -> bool:
        """Wait until something is so; return whether it came to that."""
        end = self.clock.now() + _ANSWER_S
        while not is_met() and self.clock.now() < end:
            self.clock.sleep_until(self.clock.now() + 0.02)
        return is_met()

    def _call(self, service: str) -> None:
        client = self._node.create_client(self._trigger, f"/{service}")
        if not client.wait_for_service(timeout_sec=_ANSWER_S):
            raise ConfigError(f"robot: there is no service /{service}; does the driver run?")
        answer = client.call_async(self._trigger.Request())
        if not self._await(answer.done) or not answer.result().success:
            raise ConfigError(f"robot: the driver refuses /{service}")

    def _move(self, forward: float, turn: float) -> None:
        twist = self._twist()
        twist.linear.x, twist.angular.z = float(forward), float(turn)
        self._speeds.publish(twist)

    def _hold(self, joints: np.ndarray) -> None:
        target = dict(zip(robot.JOINTS, joints.tolist(), strict=True))
        self._targets.publish(self._array(data=[*(target[name] for name in _POSE), 0.0, 0.0]))

    def _arrived_s(self, message: Any) -> float:
        """Return when a message that has just come was stamped, by the clock that is never set [s]."""
        age_s = self._node.get_clock().now().nanoseconds * 1e-9 - seconds(message)
        # None is from the future, or the last one would stay new if the computer's clock was set back.
        return self.clock.now() - max(age_s, 0.0)

    def _camera(self) -> CameraInfo:
        info = self._latest["camera_info"]
        across, down = (
            math.degrees(2.0 * math.atan(size / (2.0 * focal)))
            for size, focal in ((info.width, info.k[0]), (info.height, info.k[4]))
        )
        return CameraInfo("portrait", info.width, info.height, (across, down))
