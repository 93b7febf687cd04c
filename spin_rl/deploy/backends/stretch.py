"""A Stretch RE1, RE2 or SE3 with a dexterous wrist, by Hello Robot's own library: all calls of stretch_body.

Never tried on a robot. Written from the documentation and the interface of stretch_body 0.7.31: `Robot`,
`base.set_velocity`, `move_to` of the joints, one `push_command` a tick. The base's firmware stops it a second
after the last velocity. Joints have the signs and units of the official URDF, but for the gripper: its
commands are percents, its speeds those of the servo.
"""

from __future__ import annotations

import contextlib
import math
import signal
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
    try:
        body = require("stretch_body.robot", "hello-robot-stretch-body", "stretch", "backend")
    except KeyError as error:  # it reads the environment when it is imported
        raise ConfigError(f"backend: stretch_body needs {error} in the environment, as on a robot") from None
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
        self._heard = _Heard()

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
        """Return the latest state; its stamp is that of the device which answered longest ago."""
        status = self._body.get_status()
        base, end, head = status["base"], status["end_of_arm"], status["head"]
        gripper = end[_GRIPPER]
        wrist, camera = [end[name] for name in _WRIST], [head[name] for name in _HEAD]
        moving = [status["lift"], status["arm"], *wrist, *camera]
        finger, finger_velocity = gripper["gripper_conversion"]["finger_rad"], self._fingers(gripper["vel"])
        return RobotState(
            stamp_s=self._heard.oldest_s(self.clock.now(), self._marks(status)),
            joints=_in_order([part["pos"] for part in moving], finger),
            joint_velocity=_in_order([part["vel"] for part in moving], finger_velocity),
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
        percent = body.end_of_arm.motors[_GRIPPER].gripper_conversion.finger_to_robotis
        servo = abs(speed["gripper_finger"] / self._fingers(1.0))
        body.end_of_arm.move_to(_GRIPPER, percent(target["gripper_finger"]), v_r=servo)
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
        body.push_command()
        # Servos go on to their targets when they are moved by nothing: the library leaves such a move out.
        for chain, names in ((body.end_of_arm, _WRIST), (body.head, _HEAD)):
            for name in names:
                chain.move_to(name, chain.status[name]["pos"])

    def close(self) -> None:
        """Let go of camera and robot."""
        body, self._body = self._body, None
        try:
            if self._camera is not None:
                self._camera.stop()
        finally:
            if body is not None:
                body.stop()

    def told(self) -> Mapping[str, np.ndarray]:
        """Return nothing: there is no detector."""
        return {}

    def _fingers(self, servo: float) -> float:
        """Turn a speed of the gripper's servo into one of the fingers [rad/s]; the library's is neither's."""
        gripper = self._body.end_of_arm.motors[_GRIPPER]
        at, rest = (
            gripper.gripper_conversion.robotis_to_finger(gripper.world_rad_to_pct(x)) for x in (servo, 0.0)
        )
        return at - rest

    def _marks(self, status: Mapping[str, Any]) -> dict[str, tuple[float, int]]:
        """Return of every device what changes with its answers, and how many of them failed to come.

        Boards have clocks of their own. Servos have none: the computer's time stands for it, and is set also
        where they did not answer.
        """
        base, body = status["base"], self._body
        boards = (base["left_wheel"], base["right_wheel"], status["lift"]["motor"], status["arm"]["motor"])
        marks = {f"board {i}": (board["timestamp"], 0) for i, board in enumerate((*boards, status["pimu"]))}
        for chain, names in ((body.end_of_arm, (*_WRIST, _GRIPPER)), (body.head, _HEAD)):
            errors = chain.comm_errors.status["n_rx"]
            marks |= {name: (chain.status[name]["timestamp_pc"], errors) for name in names}
        return marks


class _Heard:
    """When every device answered last, by a clock that is never set."""

    def __init__(self) -> None:
        self._marks: dict[str, tuple[float, int]] = {}
        self._at: dict[str, float] = {}

    def oldest_s(self, now_s: float, marks: Mapping[str, tuple[float, int]]) -> float:
        """Return when the one answered that was silent for longest; before an answer of each, minus infinity.

        Args:
            now_s: The time [s].
            marks: Of every device a mark that changes with its answers, 0 before the first, and a count of
                those that failed.
        """
        for name, (mark, errors) in marks.items():
            before, failed = self._marks.get(name, (0.0, errors))
            if mark != before and errors == failed:
                self._at[name] = now_s
        self._marks.update(marks)
        return min(self._at.get(name, -math.inf) for name in marks)


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
