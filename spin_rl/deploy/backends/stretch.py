"""A Stretch RE1, RE2 or SE3 with a dexterous wrist, by Hello Robot's own library: all calls of stretch_body.

Never tried on a robot. Written from the documentation and the interface of stretch_body 0.7.31: `Robot`,
`base.set_velocity`, `move_to` and `move_by` of the joints, one `push_command` a tick. The base's firmware
stops it a second after the last velocity. Joints have the signs and units of the official URDF, but for the
gripper, which `finger_to_robotis` turns into the library's own.
"""

from __future__ import annotations

import contextlib
import signal
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from spin_rl import robot
from spin_rl.config import ConfigError, Range, from_mapping
from spin_rl.deploy.backends.dry_run import DryRun
from spin_rl.deploy.backends.realsense import RealSense
from spin_rl.deploy.clock import MonotonicClock
from spin_rl.deploy.contract import Contract
from spin_rl.deploy.interface import Clock, Command, Connection, DepthFrame, Robot, RobotState
from spin_rl.extras import require

_WRIST = ("wrist_yaw", "wrist_pitch", "wrist_roll")
_HEAD = ("head_pan", "head_tilt")
_GRIPPER = "stretch_gripper"


@dataclass(frozen=True)
class Settings:
    """Settings of the back end, `robot.<key>=<value>` on the command line.

    Attributes:
        dry_run: Whether commands are printed and nothing moves.
        width: Columns of the camera's own image.
        height: Its rows.
    """

    dry_run: bool = False
    width: Annotated[int, Range(1)] = 848
    height: Annotated[int, Range(1)] = 480


def open_robot(settings: Mapping[str, Any], contract: Contract) -> Robot:
    """Make the robot; see `backends`.

    Raises:
        ConfigError: A setting is wrong, or a library is missing.
    """
    cfg = from_mapping(Settings, settings, "robot")
    body = require("stretch_body.robot", "hello-robot-stretch-body", "stretch", "backend")
    clock = MonotonicClock()
    camera = None
    if contract.camera.image is not None:
        camera = RealSense(clock, cfg.width, cfg.height)
    opened = StretchRobot(body, clock, camera)
    return DryRun(opened) if cfg.dry_run else opened


class StretchRobot:
    """The robot; a `Robot`.

    Attributes:
        clock: The computer's.
    """

    def __init__(self, library: Any, clock: MonotonicClock, camera: RealSense | None) -> None:
        """Keep the library's module and the camera; nothing is started yet."""
        self.clock: Clock = clock
        self._library, self._camera = library, camera
        self._body: Any = None

    def connect(self) -> Connection:
        """Start the robot's devices and the camera.

        Raises:
            ConfigError: The robot does not start, lacks a joint, or has no camera.
        """
        self._body = self._library.Robot()
        with _own_signals():
            is_started = self._body.startup()
        if not is_started:
            raise ConfigError("robot: it does not start; does another program use it?")
        missing = sorted({*_WRIST, _GRIPPER} - set(self._body.end_of_arm.joints))
        if missing:
            raise ConfigError(f"robot: its arm has no {missing[0]!r}; policies need the dexterous wrist")
        return Connection(is_real=True, camera=None if self._camera is None else self._camera.start())

    def state(self) -> RobotState:
        """Return the latest state; its stamp is that of the device which was read longest ago."""
        status = self._body.get_status()
        base, end, head = status["base"], status["end_of_arm"], status["head"]
        gripper = end[_GRIPPER]
        wrist, camera = [end[name] for name in _WRIST], [head[name] for name in _HEAD]
        moving = [status["lift"], status["arm"], *wrist, *camera]
        oldest_s = min(part["timestamp_pc"] for part in (base, gripper, *moving))
        fingers = gripper["gripper_conversion"]
        return RobotState(
            stamp_s=self.clock.now() - (time.time() - oldest_s),
            joints=_in_order([part["pos"] for part in moving], fingers["finger_rad"]),
            joint_velocity=_in_order([part["vel"] for part in moving], fingers["finger_vel"]),
            base=np.array([base["x"], base["y"], base["theta"]]),
            base_velocity=np.array([base["x_vel"], base["theta_vel"]]),
            homed=bool(self._body.is_homed()),
            runstop=bool(status["pimu"]["runstop_event"]),
        )

    def depth(self) -> DepthFrame | None:
        """Return the latest image."""
        return None if self._camera is None else self._camera.frame()

    def command(self, command: Command) -> None:
        """Queue all targets, and send them at once."""
        body, target, speed = self._body, *_by_joint(command)
        body.base.set_velocity(command.forward, command.turn)
        body.lift.move_to(target["lift"], v_m=speed["lift"])
        body.arm.move_to(target["arm_extension"], v_m=speed["arm_extension"])
        for name in _WRIST:
            body.end_of_arm.move_to(name, target[name], v_r=speed[name])
        for name in _HEAD:
            body.head.move_to(name, target[name], v_r=speed[name])
        conversion = body.end_of_arm.motors[_GRIPPER].gripper_conversion
        # Its speed is one of the servo, whose ratio to the fingers the library does not tell.
        body.end_of_arm.move_to(_GRIPPER, conversion.finger_to_robotis(target["gripper_finger"]))
        body.push_command()

    def stop(self) -> None:
        """Stand, then hold the joints; the fingers keep their target, or they would lose what they hold."""
        body = self._body
        if body is None:
            return
        body.base.set_velocity(0.0, 0.0)
        body.push_command()
        body.lift.move_by(0.0)
        body.arm.move_by(0.0)
        for name in _WRIST:
            body.end_of_arm.move_by(name, 0.0)
        for name in _HEAD:
            body.head.move_by(name, 0.0)
        body.push_command()

    def close(self) -> None:
        """Let go of camera and robot."""
        if self._camera is not None:
            self._camera.stop()
        if self._body is not None:
            self._body.stop()
            self._body = None

    def told(self) -> Mapping[str, np.ndarray]:
        """Return nothing: there is no detector."""
        return {}


def _in_order(moving: list[float], finger: float) -> np.ndarray:
    """Put the fingers between wrist and head, as in `robot.JOINTS`, shape (8,)."""
    return np.array([*moving[:5], finger, *moving[5:]], dtype=float)


def _by_joint(command: Command) -> tuple[dict[str, float], dict[str, float]]:
    """Return targets and largest speeds by the joint's name."""
    return (
        dict(zip(robot.JOINTS, command.joints.tolist(), strict=True)),
        dict(zip(robot.JOINTS, command.joint_speed.tolist(), strict=True)),
    )


@contextlib.contextmanager
def _own_signals() -> Iterator[None]:
    """Keep the handlers of signals: the library puts its own in their place, which end the program."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
