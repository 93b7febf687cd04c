"""What a robot must be before it moves, and while it does."""

from __future__ import annotations

import math

import numpy as np

from spin_rl import robot
from spin_rl.config import ConfigError
from spin_rl.deploy.contract import Camera, Contract
from spin_rl.deploy.interface import CameraInfo, Connection, DepthFrame, RobotState

MAX_AGE_S = 0.5
"""Oldest observation to act on, and the farthest from the future, which tells of clocks that do not agree.

The base's own firmware stops a second after the last command.
"""
_OBJECT_TERMS = {"object_start", "object_start_near", "object_start_close"}
_LIMIT_SLACK = 0.03
"""How far encoders may read beyond a limit [m, rad]."""
_JUMP_M, _JUMP_RAD = 0.2, 0.3
_MOST_M_S, _MOST_RAD_S = 1.5, 3.0
"""No Stretch drives or turns so fast; what its odometry does beyond that is none of its motion."""
_FOV_SLACK = 0.1
"""Part by which the tangent of half a camera's field of view may differ from that of the training."""


def check_policy(contract: Contract, connection: Connection, told: set[str]) -> None:
    """Reject a policy that the robot cannot run.

    Args:
        contract: Of the policy.
        connection: The robot.
        told: Names of the groups that the back end tells beside the robot's own.

    Raises:
        ConfigError: One line that says why.
    """
    if connection.is_real and contract.simulation_only is not None:
        raise ConfigError(f"policy: {contract.name} is for simulation only: {contract.simulation_only}")
    computed = {group.name for group in contract.observations if group.terms or group.source == "camera"}
    for name in contract.observation_names:
        if name not in computed | told:
            raise ConfigError(f"policy: {contract.name} reads {name!r}, which this back end cannot tell")
    if contract.camera.image is not None:
        check_camera(contract.camera, connection)


def check_camera(wanted: Camera, connection: Connection) -> None:
    """Reject a depth camera that is not the training's.

    Raises:
        ConfigError: There is none, or mount, size or field of view are wrong.
    """
    camera = connection.camera
    assert wanted.image is not None
    if camera is None:
        raise ConfigError("camera: the policy reads depth images, and there is no depth camera")
    if camera.mount != wanted.mount:
        raise ConfigError(f"camera: mounted in {camera.mount}, the policy knows {wanted.mount}")
    on_side = wanted.mount == "portrait"
    height, width = wanted.image[::-1] if on_side else wanted.image
    if camera.width < width or camera.height < height:
        found = f"{camera.width} x {camera.height}"
        raise ConfigError(f"camera: images of {found} are smaller than the policy's, {width} x {height}")
    fov = wanted.fov_deg if on_side else wanted.fov_deg[::-1]
    for found, known, along in zip(camera.fov_deg, fov, ("width", "height"), strict=True):
        ratio = math.tan(math.radians(found) / 2) / math.tan(math.radians(known) / 2)
        if not abs(ratio - 1.0) <= _FOV_SLACK:
            raise ConfigError(f"camera: sees {found:g} degrees along its {along}, the policy knows {known:g}")


def check_frame(frame: DepthFrame | None, camera: CameraInfo | None) -> None:
    """Reject images of another size than the camera is said to have.

    Raises:
        ConfigError: They are.
    """
    if frame is not None and camera is not None and frame.image.shape != (camera.height, camera.width):
        rows, columns = frame.image.shape
        raise ConfigError(
            f"camera: gives images of {columns} x {rows}, and said {camera.width} x {camera.height}"
        )


def check_aims(contract: Contract, goal: np.ndarray | None, object_b: np.ndarray | None) -> None:
    """Reject a run without what its policy is told.

    Raises:
        ConfigError: The goal or the object's place is missing, or is no point.
    """
    terms = {term.name for group in contract.observations for term in group.terms}
    aims = (("goal", goal, 2, "goal" in terms), ("object", object_b, 3, bool(terms & _OBJECT_TERMS)))
    for key, point, size, is_needed in aims:
        if is_needed and point is None:
            raise ConfigError(f"{key}: {contract.name} needs one, as {size} numbers [m]")
        if point is not None and not (point.shape == (size,) and np.isfinite(point).all()):
            raise ConfigError(f"{key}: expected {size} numbers [m], got {point.tolist()}")


def check_start(state: RobotState) -> None:
    """Reject a state to start from.

    Raises:
        ConfigError: The robot is not homed, its runstop is pressed, or a joint is outside its limits.
    """
    if not state.homed:
        raise ConfigError("robot: not homed; home it first")
    if state.runstop:
        raise ConfigError("robot: the runstop is pressed; release it first")
    limits = zip(robot.JOINTS, state.joints, robot.JOINT_LOWER, robot.JOINT_UPPER, strict=True)
    for name, value, low, high in limits:
        if not low - _LIMIT_SLACK <= value <= high + _LIMIT_SLACK:  # also catches NaN
            raise ConfigError(f"robot: joint {name!r} is at {value:.3f}, outside [{low}, {high}]")
    if not is_finite(state):
        raise ConfigError("robot: its state is not finite")


def why_stop(now_s: float, state: RobotState, frame: DepthFrame | None, reads_images: bool) -> str | None:
    """Return why the robot must stop now, or None.

    Args:
        now_s: By the clock of the stamps [s].
        state: Latest state.
        frame: Latest depth image.
        reads_images: Whether the policy needs one.
    """
    if state.runstop:
        return "runstop"
    if not is_finite(state):
        return "the robot's state is not finite"
    if not abs(now_s - state.stamp_s) <= MAX_AGE_S:
        return f"the robot's state is {now_s - state.stamp_s:.2f} s old"
    if reads_images and frame is None:
        return "no depth image"
    if reads_images and frame is not None and not abs(now_s - frame.stamp_s) <= MAX_AGE_S:
        return f"the depth image is {now_s - frame.stamp_s:.2f} s old"
    return None


class Watch:
    """What only several steps tell: an odometry that jumps, and a camera that shows nothing."""

    def __init__(self, now_s: float) -> None:
        """Begin at a time [s]."""
        self._base: np.ndarray | None = None
        self._at_s = self._saw_s = now_s

    def why_stop(self, now_s: float, base: np.ndarray, depth: np.ndarray | None) -> str | None:
        """Return why the robot must stop now, or None.

        Args:
            now_s: The time [s].
            base: Pose of the base by the odometry, x, y [m], yaw [rad].
            depth: The image [m], 0 where nothing was measured; None without one.
        """
        before, self._base = self._base, base
        passed_s, self._at_s = now_s - self._at_s, now_s
        if before is not None:
            moved, turned = math.hypot(*(base - before)[:2]), math.remainder(base[2] - before[2], math.tau)
            if moved > _JUMP_M + _MOST_M_S * passed_s or abs(turned) > _JUMP_RAD + _MOST_RAD_S * passed_s:
                return f"the odometry jumped by {moved:.2f} m and {turned:.2f} rad"
        if depth is None or depth.any():
            self._saw_s = now_s
        if now_s - self._saw_s > MAX_AGE_S:
            return f"the depth images have shown nothing for {now_s - self._saw_s:.2f} s"
        return None


def is_finite(state: RobotState) -> bool:
    """Whether all numbers of a state are."""
    return all(
        np.isfinite(values).all()
        for values in (state.joints, state.joint_velocity, state.base, state.base_velocity)
    )
