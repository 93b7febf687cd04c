"""What the control loop asks of a robot, real or simulated, and what the two hand each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from spin_rl.robot import CameraMount


class DeviceLost(OSError):
    """A device of the robot does not answer any more."""


@dataclass(frozen=True)
class RobotState:
    """What the robot measures of itself.

    Attributes:
        stamp_s: When, by the back end's clock [s].
        joints: Positions in `robot.JOINTS` order [m, rad], shape (8,).
        joint_velocity: Their velocities [m/s, rad/s], shape (8,).
        base: Pose of the base by odometry: x, y [m], yaw [rad]; the frame is any that stays, shape (3,).
        base_velocity: Forward [m/s] and turning [rad/s], shape (2,).
        homed: Whether all joints know where they are.
        runstop: Whether the runstop is pressed.
    """

    stamp_s: float
    joints: np.ndarray
    joint_velocity: np.ndarray
    base: np.ndarray
    base_velocity: np.ndarray
    homed: bool = True
    runstop: bool = False


@dataclass(frozen=True)
class DepthFrame:
    """A depth image as the camera gives it, not turned.

    Attributes:
        stamp_s: When it was taken, by the back end's clock [s].
        image: Depth along the optical axis [m], 0 or not finite where nothing was measured, shape (height,
            width).
    """

    stamp_s: float
    image: np.ndarray


@dataclass(frozen=True)
class CameraInfo:
    """The depth camera of a robot.

    Attributes:
        mount: As in `contract.Camera`.
        width: Columns of its own image.
        height: Rows of its own image.
        fov_deg: Its field of view across and down its own image.
    """

    mount: CameraMount
    width: int
    height: int
    fov_deg: tuple[float, float]


@dataclass(frozen=True)
class Command:
    """What the robot shall do until the next command.

    Attributes:
        forward: Speed of the base [m/s].
        turn: Turning speed of the base [rad/s].
        joints: Targets of the joints in `robot.JOINTS` order [m, rad], shape (8,).
        joint_speed: Largest speed of each joint on the way there [m/s, rad/s], shape (8,).
    """

    forward: float
    turn: float
    joints: np.ndarray
    joint_speed: np.ndarray


@dataclass(frozen=True)
class Connection:
    """What a back end knows when it is connected.

    Attributes:
        is_real: Whether there is a machine that can do harm.
        camera: Its depth camera, if it has one.
        goal: Where to drive in the frame of its odometry [m], if it knows.
        object_b: Where the object to pick is in the frame of the base now [m], if it knows.
    """

    is_real: bool
    camera: CameraInfo | None = None
    goal: tuple[float, float] | None = None
    object_b: tuple[float, float, float] | None = None


class Clock(Protocol):
    """Time that never goes back."""

    def now(self) -> float:
        """Return the time [s]."""
        ...

    def sleep_until(self, time_s: float) -> None:
        """Return at a time [s], at once if it has passed; a signal may end the sleep early."""
        ...


class Robot(Protocol):
    """A back end. Every method but `stop` and `close` may raise `DeviceLost`; none may wait long.

    Attributes:
        clock: Its time, that of all stamps.
    """

    clock: Clock

    def connect(self) -> Connection:
        """Start the devices; nothing moves.

        Raises:
            ConfigError: It cannot be used as asked.
        """
        ...

    def state(self) -> RobotState:
        """Return the latest state, however old; its stamp tells."""
        ...

    def depth(self) -> DepthFrame | None:
        """Return the latest depth image, however old; None before the first, or without a camera."""
        ...

    def command(self, command: Command) -> None:
        """Hand a command to the devices."""
        ...

    def stop(self) -> None:
        """Command zero velocity and hold the joints where they are; must work in any state, also twice."""
        ...

    def close(self) -> None:
        """Let go of the devices."""
        ...

    def told(self) -> Mapping[str, np.ndarray]:
        """Return observation groups that only a simulator or a detector can tell, by name."""
        ...
