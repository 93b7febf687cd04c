"""The head poses that are compared, the cameras at them, and the robot's body that hides things from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import warp as wp

from spin_rl import robot
from spin_rl.config import ConfigError
from spin_rl.sim.simulation import Simulation
from spin_rl.warp_kernels.sight import Body, Heads

_HEAD = "head_tilt"
"""The body that carries the camera: it never stands before it."""

_THERE_RAD = np.deg2rad(5.0)
"""The head has arrived when it is so near to a pose."""

_DRAWN = 2
"""Group of the geoms that look like the robot; those that collide are larger."""


@dataclass(frozen=True)
class Poses:
    """A grid of head poses; pose i has pan i // len(tilts) and tilt i % len(tilts).

    Attributes:
        pans: Ascending [rad].
        tilts: Ascending [rad].
    """

    pans: tuple[float, ...]
    tilts: tuple[float, ...]

    def __post_init__(self) -> None:
        """Reject angles that the head cannot take.

        Raises:
            ConfigError: One line that names the key.
        """
        for name, joint, values in zip(
            ("pans", "tilts"), robot.CAMERA_JOINTS, (self.pans, self.tilts), strict=True
        ):
            index = robot.JOINTS.index(joint)
            low, high = robot.JOINT_LOWER[index], robot.JOINT_UPPER[index]
            if (
                not values
                or list(values) != sorted(set(values))
                or not low <= values[0] <= values[-1] <= high
            ):
                raise ConfigError(
                    f"sight.{name}: expected ascending angles within [{low}, {high}], got {list(values)}"
                )

    def __len__(self) -> int:
        return len(self.pans) * len(self.tilts)

    @property
    def table(self) -> np.ndarray:
        """Pan and tilt of every pose [rad], shape (npose, 2)."""
        return np.array([(pan, tilt) for pan in self.pans for tilt in self.tilts])

    def travel_s(self, profile: robot.SpeedProfile) -> np.ndarray:
        """Time that the head takes from any pose to within 5 degrees of any other [s], shape (npose, npose).

        The servos are first-order with a speed limit: full speed at first, and then what is left shrinks
        exponentially.
        """
        away = np.abs(self.table[:, None] - self.table[None])
        speed = np.array(
            [profile.joint_velocity_max[robot.JOINTS.index(joint)] for joint in robot.CAMERA_JOINTS]
        )
        lag = profile.joint_time_constant
        slow = np.minimum(away, speed * lag)
        times = (away - slow) / speed + lag * np.log(np.maximum(slow, _THERE_RAD) / _THERE_RAD)
        return times.max(axis=-1)


def cameras_in_base(poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions [m] and rotations of the camera's optical frame in the base frame at head poses.

    Args:
        poses: Pan and tilt [rad], shape (n, 2).

    Returns:
        Shapes (n, 3) and (n, 3, 3); axes x, y across the image, z forward.
    """
    model = robot.load_spec().compile()
    data = mujoco.MjData(model)
    positions, rotations = [], []
    for pose in poses:
        held = {**robot.STOWED, **dict(zip(robot.CAMERA_JOINTS, pose, strict=True))}
        data.qpos[:] = robot.qpos_from_joints(model, held)
        mujoco.mj_kinematics(model, data)
        site = data.site(robot.CAMERA_SITE)
        positions.append(site.xpos.copy())
        rotations.append(site.xmat.reshape(3, 3).copy())
    return np.array(positions), np.array(rotations)


def make_heads(poses: Poses, mount: robot.CameraMount, near: float, device: str) -> Any:
    """Allocate the cameras of a grid of poses, with a mount and the smallest depth that they see [m]."""
    positions, rotations = cameras_in_base(poses.table)
    heads = Heads()
    heads.pos = wp.array(positions, dtype=wp.vec3, device=device)
    heads.mat = wp.array(rotations, dtype=wp.mat33, device=device)
    heads.tan_half_fov = wp.vec2(*robot.camera_tan_half_fov(mount))
    heads.near = near
    return heads


def make_body(sim: Simulation) -> Any:
    """Allocate what of a simulation's robot hides: all that is drawn, but the camera's own head.

    Capsules count as cylinders to their tips.
    """
    model = sim.mj_model
    bodies = [model.body(model.geom_bodyid[geom]).name for geom in range(model.ngeom)]
    geoms = [
        geom
        for geom in range(model.ngeom)
        if model.geom_bodyid[geom] > 0 and model.geom_group[geom] == _DRAWN and bodies[geom] != _HEAD
    ]
    kinds, sizes = [], []
    for geom in geoms:
        size, kind = model.geom_size[geom], model.geom_type[geom]
        if kind == mujoco.mjtGeom.mjGEOM_BOX:
            kinds.append(0)
            sizes.append(tuple(size))
        else:
            tip = size[0] if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0
            kinds.append(1)
            sizes.append((size[0], size[0], size[1] + tip))
    body = Body()
    body.xpos, body.xmat = sim.data.geom_xpos, sim.data.geom_xmat
    with wp.ScopedDevice(sim.device):
        body.geoms = wp.array(geoms, dtype=wp.int32)
        body.kinds = wp.array(kinds, dtype=wp.int32)
        body.sizes = wp.array(sizes, dtype=wp.vec3)
    return body
