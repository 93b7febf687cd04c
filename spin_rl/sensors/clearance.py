# pyright: reportGeneralTypeIssues=false
# (to a type checker, a Warp struct is an object, not a class)
"""Clearance of the robot: its collision geoms from the model, and the buffers of the kernel."""

from __future__ import annotations

from typing import TYPE_CHECKING

import mujoco
import numpy as np
import warp as wp

from spin_rl.sensors.interface import Sensor
from spin_rl.warp_kernels.clearance import BodyMotion, Shapes, measure_clearance
from spin_rl.warp_kernels.slots import slots_of
from spin_rl.warp_kernels.structs import struct_of

if TYPE_CHECKING:
    from spin_rl.sim.simulation import Simulation


class Clearance(Sensor):
    """Distance to the nearest wall or obstacle, and the squared speed of what is near.

    Attributes:
        clearance: Smallest distance of a collision geom to a slot [m], at most the limit, shape (nworld,).
        haste: Largest squared speed times 1 - distance / limit over the geoms [m^2/s^2], shape (nworld,).
    """

    def __init__(self, sim: Simulation, limit: float) -> None:
        """Allocate the buffers.

        Args:
            sim: The simulation; its poses, velocities and layout are read at every update.
            limit: Distance from which nothing is near [m].

        Raises:
            ValueError: The limit is not positive, the robot has a shape that the kernel cannot measure, or
                the simulation computes no velocities of bodies.
        """
        if not limit > 0.0:
            raise ValueError(f"limit must be positive, got {limit}")
        if sim.config.kinematic:
            raise ValueError("reward.clearance needs velocities of bodies, which sim.kinematic leaves out")
        self._limit = limit
        device = sim.device
        self._shapes = robot_shapes(sim.mj_model, device)
        self._motion = struct_of(BodyMotion, sim.data, root=int(sim.mj_model.body("base").id))
        self._obstacles = slots_of(sim.layout)
        self.clearance = wp.full(sim.nworld, limit, dtype=float, device=device)
        self.haste = wp.zeros(sim.nworld, dtype=float, device=device)

    def update(self) -> None:
        """Measure from the current poses and velocities; graph-safe.

        After `Simulation.advance` these are those of the start of its last substep, as for contacts.
        """
        measure_clearance(
            self._shapes,
            self._motion,
            self._obstacles,
            limit=self._limit,
            clearance_out=self.clearance,
            haste_out=self.haste,
        )


def robot_shapes(model: mujoco.MjModel, device: str) -> Shapes:
    """Collect the robot's collision geoms for the kernel.

    Args:
        model: Robot and scene pool.
        device: Warp device.

    Raises:
        ValueError: A collision geom is neither a capsule nor an upright box.
    """
    geoms = [
        geom
        for geom in range(model.ngeom)
        if model.geom_bodyid[geom] > 0 and (model.geom_contype[geom] or model.geom_conaffinity[geom])
    ]
    boxes = model.geom_type[geoms] == mujoco.mjtGeom.mjGEOM_BOX
    upright = np.array([_is_upright(model, geom) for geom in geoms])
    for geom, is_box, is_upright in zip(geoms, boxes, upright, strict=True):
        is_capsule = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE
        if not (is_capsule or (is_box and is_upright)):
            raise ValueError(f"collision geom {model.geom(geom).name!r} is no capsule and no upright box")
    size, bound = model.geom_size[geoms], model.geom_rbound[geoms]
    radius = np.where(boxes, 0.0, size[:, 0])
    half_size = np.where(boxes[:, None], size, size[:, 1:2] * (0.0, 0.0, 1.0))
    across = np.where(boxes, np.hypot(size[:, 0], size[:, 1]), radius)
    reach = np.where(upright[:, None], np.stack([across, half_size[:, 2] + radius], -1), bound[:, None])
    shapes = Shapes()
    with wp.ScopedDevice(device):
        shapes.geom = wp.array(geoms, dtype=wp.int32)
        shapes.body = wp.array(model.geom_bodyid[geoms], dtype=wp.int32)
        shapes.is_box = wp.array(boxes, dtype=bool)
        shapes.half_size = wp.array(half_size, dtype=wp.vec3)
        shapes.radius = wp.array(radius, dtype=float)
        shapes.reach = wp.array(reach, dtype=wp.vec2)
    return shapes


def _is_upright(model: mujoco.MjModel, geom: int) -> bool:
    """Whether a geom's z axis stays vertical: neither its frames nor the hinges above it tilt."""
    vertical = np.array([0.0, 0.0, 1.0])
    rotation = np.zeros(9)

    def keeps_vertical(quat: np.ndarray) -> bool:
        mujoco.mju_quat2Mat(rotation, quat)
        return bool(np.allclose(rotation.reshape(3, 3) @ vertical, vertical, atol=1e-6))

    upright = keeps_vertical(model.geom_quat[geom])
    body = model.geom_bodyid[geom]
    while body > 0:
        upright &= keeps_vertical(model.body_quat[body])
        first = model.body_jntadr[body]
        for joint in range(first, first + model.body_jntnum[body]):
            turns = model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_SLIDE
            upright &= not turns or bool(np.allclose(np.abs(model.jnt_axis[joint]), vertical))
        body = model.body_parentid[body]
    return upright
