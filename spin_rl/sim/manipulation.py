"""The object to pick up in every world, and the forces of grasping it."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import mujoco_warp as mjw
import numpy as np
import torch
import warp as wp

from spin_rl import robot
from spin_rl.scenes.objects.model import ObjectIds, ObjectModel, ObjectStart, write_objects
from spin_rl.scenes.objects.shapes import OBJECT_BODY, OBJECTS, SceneObject
from spin_rl.sim.object_start import place_objects
from spin_rl.sim.targets import ManipulationConfig, make_increments
from spin_rl.warp_kernels import grasp


@dataclass
class ObjectViews:
    """Zero-copy Torch views of `ObjectState` and of the object's pose and velocity in the simulator.

    Attributes:
        pos: Where the object's centre is now [m], shape (nworld, 3).
        quat: Its orientation now (w, x, y, z), shape (nworld, 4).
        velocity: Linear [m/s] and angular [rad/s, in its own frame] velocity, shape (nworld, 6).
    """

    kind: torch.Tensor
    start_pose: torch.Tensor
    half_extents: torch.Tensor
    mass: torch.Tensor
    friction: torch.Tensor
    near: torch.Tensor
    pos: torch.Tensor
    quat: torch.Tensor
    velocity: torch.Tensor


class ObjectState:
    """What every world's object is and where it starts; `Simulation.reset` puts it there.

    Attributes:
        kind: Index into `objects.OBJECTS`, shape (nworld,), int32.
        start_pose: Position of the centre [m] and yaw [rad], shape (nworld,), vec4.
        half_extents: Half sizes of the bounding box in its own frame [m], shape (nworld,), vec3.
        mass: Mass [kg], shape (nworld,).
        friction: Sliding friction of the fingertips' pads, shape (nworld,).
        near: Whether the episode started with the gripper close to the object, shape (nworld,), bool.
        start: The arrays above in one struct, for kernels.
    """

    def __init__(self, nworld: int, data: mjw.Data, device: str) -> None:
        """Allocate the state on the device; `data` gives the current pose."""
        self.nworld = nworld
        self.device = device
        with wp.ScopedDevice(device):
            self.kind = wp.zeros(nworld, dtype=wp.int32)
            self.start_pose = wp.full(nworld, wp.vec4(0.0, -5.0, 0.5, 0.0), dtype=wp.vec4)
            self.half_extents = wp.full(nworld, wp.vec3(0.1, 0.04, 0.02), dtype=wp.vec3)
            self.mass = wp.full(nworld, 0.1, dtype=float)
            self.friction = wp.full(nworld, 1.2, dtype=float)
            self.near = wp.zeros(nworld, dtype=bool)
        self.start = ObjectStart()
        for name in ObjectStart.vars:
            setattr(self.start, name, getattr(self, name))
        nq, nv = len(robot.DOF_NAMES), len(robot.DOF_NAMES)
        qpos, qvel = wp.to_torch(data.qpos), wp.to_torch(data.qvel)
        self.views = ObjectViews(
            **{name: wp.to_torch(getattr(self, name)) for name in ObjectStart.vars},
            pos=qpos[:, nq : nq + 3],
            quat=qpos[:, nq + 3 :],
            velocity=qvel[:, nv:],
        )

    def scene_object(self, world: int) -> SceneObject:
        """Copy one world's object to the host."""
        return SceneObject(
            kind=OBJECTS[int(self.kind.numpy()[world])],
            half_extents=self.half_extents.numpy()[world].astype(np.float64),
            mass=float(self.mass.numpy()[world]),
            friction=float(self.friction.numpy()[world]),
            start_pose=self.start_pose.numpy()[world].astype(np.float64),
        )


@dataclass
class GraspViews:
    """Zero-copy Torch views of `GraspForces`."""

    finger_force: torch.Tensor
    table_force: torch.Tensor
    hard_contact: torch.Tensor
    object_support: torch.Tensor


class GraspForces:
    """Normal forces during the last control step.

    Attributes:
        finger_force: Of the left and the right fingertip on the object in the last substep [N], shape
            (nworld, 2).
        table_force: Of fingers and fingertips on scene and floor, largest sum of any substep [N], shape
            (nworld,).
        hard_contact: Likewise of every other part of the robot [N], shape (nworld,).
        object_support: Whether scene or floor bore the object in the last substep, shape (nworld,), bool.
    """

    def __init__(self, nworld: int, mj_model: mujoco.MjModel, device: str) -> None:
        """Allocate the forces and the role of every geom."""
        with wp.ScopedDevice(device):
            self.finger_force = wp.zeros((nworld, 2), dtype=float)
            self.table_force = wp.zeros(nworld, dtype=float)
            self.hard_contact = wp.zeros(nworld, dtype=float)
            self.object_support = wp.zeros(nworld, dtype=bool)
            self._sums = wp.zeros((nworld, grasp.NUM_SUMS), dtype=float)
            self._roles = wp.array(geom_roles(mj_model), dtype=wp.int32)
        self.views = GraspViews(
            finger_force=wp.to_torch(self.finger_force),
            table_force=wp.to_torch(self.table_force),
            hard_contact=wp.to_torch(self.hard_contact),
            object_support=wp.to_torch(self.object_support),
        )

    def clear(self) -> None:
        """Begin a control step."""
        self.table_force.zero_()
        self.hard_contact.zero_()

    def add_substep(self, data: mjw.Data) -> None:
        """Read the forces of the physics step just done."""
        grasp.grasp_forces(
            data.contact.geom,
            data.contact.worldid,
            data.contact.type,
            data.contact.efc_address,
            data.nacon,
            data.efc.force,
            self._roles,
            self._sums,
            finger_out=self.finger_force,
            table_out=self.table_force,
            hard_out=self.hard_contact,
            support_out=self.object_support,
        )


class Manipulation:
    """The parts of a `Simulation` that only manipulation has.

    Attributes:
        object: The object of every world.
        grasp: Forces of the last control step.
        increments: How actions move the joint targets.
    """

    def __init__(
        self,
        config: ManipulationConfig,
        nworld: int,
        mj_model: mujoco.MjModel,
        model: mjw.Model,
        data: mjw.Data,
        period: float,
        device: str,
    ) -> None:
        """Allocate everything for a batched model that has `objects.MODEL_FIELDS` per world.

        Args:
            config: Options.
            nworld: Number of worlds.
            mj_model: The model that `model` was made of.
            model: Batched model, whose object is written at resets.
            data: Its state.
            period: Control period [s].
            device: Warp device.
        """
        self.object = ObjectState(nworld, data, device)
        self.grasp = GraspForces(nworld, mj_model, device)
        self.increments = make_increments(config.increments, period, device)
        self._ids = ObjectIds.of(mj_model, device)
        self._model = ObjectModel()
        for name in ObjectModel.vars:
            setattr(self._model, name, getattr(model, name))

    def reset(self, mask: wp.array, data: mjw.Data, mode: wp.array, action: wp.array) -> None:
        """Shape and place the masked worlds' objects; the robot's start state must have been set.

        Args:
            mask: Worlds to reset, shape (nworld,), bool.
            data: State to write the object's pose to.
            mode: See `targets.set_targets`.
            action: Output, in incremental worlds the action that holds the start pose, shape (nworld, 10).
        """
        state = self.object
        write_objects(
            self._ids,
            mask,
            kind=state.kind,
            half_extents=state.half_extents,
            mass=state.mass,
            friction=state.friction,
            out=self._model,
        )
        place_objects(self.increments, mask, state.start_pose, mode, qpos=data.qpos, action=action)


def geom_roles(model: mujoco.MjModel) -> list[int]:
    """Return what `grasp_forces` takes each geom for."""
    pads = {
        name: role
        for names, role in zip(robot.PADS.values(), (grasp.LEFT_PAD, grasp.RIGHT_PAD), strict=True)
        for name in names
    }
    fingers = {model.body(body).id for body in robot.PADS}
    target = model.body(OBJECT_BODY).id
    roles = []
    for geom in range(model.ngeom):
        body = model.geom_bodyid[geom]
        if not (model.geom_contype[geom] or model.geom_conaffinity[geom]):
            roles.append(0)
        elif body == 0:
            roles.append(int(grasp.SCENE))
        elif body == target:
            roles.append(int(grasp.OBJECT))
        elif body in fingers:
            roles.append(int(pads.get(model.geom(geom).name, grasp.FINGER)))
        else:
            roles.append(int(grasp.HARD_PART))
    return roles
