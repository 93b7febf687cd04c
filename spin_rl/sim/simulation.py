"""Thousands of Stretch worlds in mujoco-warp, stepped and reset without leaving the device."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco_warp as mjw
import torch
import warp as wp

from spin_rl import robot
from spin_rl.scenes.builder import geoms_of, write_geoms
from spin_rl.scenes.layout import Layout, PoolSpec
from spin_rl.scenes.motion import move_slots, restart_motion
from spin_rl.scenes.objects.model import MODEL_FIELDS
from spin_rl.sim import drive as drive_module
from spin_rl.sim.config import SimConfig
from spin_rl.sim.kinematic import kinematic_step
from spin_rl.sim.manipulation import GraspForces, Manipulation, ObjectState
from spin_rl.sim.model import compile_model, geom_parts
from spin_rl.sim.nearby import Nearby
from spin_rl.sim.reset import set_start_state
from spin_rl.sim.targets import (
    ABSOLUTE,
    INCREMENTAL,
    IncrementConfig,
    ManipulationConfig,
    make_increments,
    set_targets,
)
from spin_rl.warp_kernels.contacts import clear_part_contacts, part_contacts

# Bits of mujoco_warp's Data.overflow that say that contacts or constraints were dropped, with the SimConfig
# key that makes room for them (none for a buffer of fixed size). The solver's iteration limits are no losses:
# few iterations are a choice here. The other bits belong to features that this model does not use.
OVERFLOWS: dict[str, tuple[int, str | None]] = {
    "njmax": (int(mjw.OverflowType.NEFC), "constraints_per_world"),
    "njmax_nnz": (int(mjw.OverflowType.NJMAX_NNZ), "constraints_per_world"),
    "broadphase": (int(mjw.OverflowType.BROADPHASE), "contacts_per_world"),
    "narrowphase": (int(mjw.OverflowType.NARROWPHASE), "contacts_per_world"),
    "ccd": (int(mjw.OverflowType.CCD), "contacts_per_world"),
    "epa_horizon": (int(mjw.OverflowType.EPA_HORIZON), None),
}
_SCENE_FIELDS = ("geom_size", "geom_rbound", "geom_aabb")


@dataclass
class Dynamics:
    """Per-world servo parameters, randomized at reset.

    Attributes:
        lag: Time constants of base and joints [s], shape (nworld, 2).
        speed_scale: Factor on every speed limit, shape (nworld,).
        acceleration_scale: Factor on the base's acceleration limits, shape (nworld,).
    """

    lag: wp.array
    speed_scale: wp.array
    acceleration_scale: wp.array


@dataclass
class Contacts:
    """What the robot touched during the last control step.

    Attributes:
        parts: Whether a part of `robot.PARTS` touched the scene or the floor, shape (nworld, 6), bool.
        self_contact: Whether the gripper or wrist touched the base, shape (nworld,), bool.
    """

    parts: wp.array
    self_contact: wp.array


@dataclass
class Views:
    """Zero-copy Torch views of simulator memory; see the Warp arrays of the same names.

    With manipulation, `qpos` and `qvel` end with the object's free joint.
    """

    qpos: torch.Tensor
    qvel: torch.Tensor
    site_pos: torch.Tensor
    action: torch.Tensor
    target: torch.Tensor
    mode: torch.Tensor
    base_velocity: torch.Tensor
    part_contacts: torch.Tensor
    self_contact: torch.Tensor


class Simulation:
    """The batched robot in its scenes.

    Arrays are allocated here once and never replaced: captured graphs keep their addresses. All methods but
    the constructor only launch kernels, so that a task can capture them with its own in one graph.

    Attributes:
        target: Joint targets in `robot.JOINTS` order [m or rad], shape (nworld, 8).
        nearby: What keeps the scene geoms near the robot; None where the pool is so small that all are.
        increments: What an action does in the mode `targets.INCREMENTAL`.
        mode: How actions are read, `targets.ABSOLUTE` (navigation) or `targets.INCREMENTAL` (manipulation),
            shape (nworld,), int32; the latter only with manipulation, where it is the default.
    """

    def __init__(
        self,
        nworld: int,
        pool: PoolSpec,
        profile: robot.SpeedProfile,
        config: SimConfig,
        device: str,
        *,
        moving: bool = False,
        manipulation: ManipulationConfig | None = None,
    ) -> None:
        """Compile the model and allocate every world.

        Args:
            nworld: Number of worlds.
            pool: Scene geoms that every world has.
            profile: Speed limits of the robot.
            config: Physics options.
            device: Warp device, "cpu" or "cuda:N".
            moving: Whether obstacles may move; otherwise nothing is launched for it.
            manipulation: Options of the grasping robot and the object to grasp; without them there is the
                robot for navigation alone.

        Raises:
            ValueError: `config.kinematic` with manipulation, which lives by forces.
        """
        if config.kinematic and manipulation is not None:
            raise ValueError("sim.kinematic: this task needs forces, take sim=grasp")
        self.nworld = nworld
        self._moving = moving
        self.device = device
        self.config = config
        self.layout = Layout(nworld, pool, device, config.nearby)
        self.mj_model = compile_model(pool, config, with_object=manipulation is not None)
        with wp.ScopedDevice(device):
            fields = _SCENE_FIELDS if manipulation is None else sorted({*_SCENE_FIELDS, *MODEL_FIELDS})
            self.model = mjw.put_model(self.mj_model, batch_sizes=dict.fromkeys(fields, nworld))
            self.model.opt.warn_overflow = 0
            self.data = mjw.make_data(
                self.mj_model,
                nworld=nworld,
                nconmax=config.contacts_per_world,
                njmax=config.constraints_per_world,
            )
            self.action = wp.zeros((nworld, len(robot.ACTIONS)), dtype=float)
            self.base_velocity = wp.zeros((nworld, 2), dtype=float)
            self._base_target = wp.zeros((nworld, 2), dtype=float)
            self.target = wp.zeros((nworld, len(robot.JOINTS)), dtype=float)
            mode = ABSOLUTE if manipulation is None else INCREMENTAL
            self.mode = wp.full(nworld, int(mode), dtype=wp.int32)
            self.dynamics = Dynamics(
                lag=wp.array(
                    [[profile.base_time_constant, profile.joint_time_constant]] * nworld, dtype=float
                ),
                speed_scale=wp.full(nworld, 1.0, dtype=float),
                acceleration_scale=wp.full(nworld, 1.0, dtype=float),
            )
            self.contacts = Contacts(
                parts=wp.zeros((nworld, len(robot.PARTS)), dtype=bool),
                self_contact=wp.zeros(nworld, dtype=bool),
            )
            self._scene_geoms = wp.array(
                [self.mj_model.geom(name).id for name in pool.geom_names()], dtype=wp.int32
            )
            self._geoms = geoms_of(self.model, self.data)
            self._geom_part = wp.array(geom_parts(self.mj_model), dtype=wp.int32)
            # Everything that belongs to the world body: the floor and the scene pool.
            self._geom_is_scene = wp.array(self.mj_model.geom_bodyid == 0, dtype=bool)
            follows = config.nearby < pool.num_slots
            self.nearby = None
            if follows:
                alone = manipulation is None
                self.nearby = Nearby(self.layout, self.mj_model, self.model, self.data, robot_alone=alone)
            self.limits = drive_module.DriveLimits.create(profile, device)
        self._manipulation = None
        self.increments = make_increments(IncrementConfig(), config.control_period, device)
        if manipulation is not None:
            self._manipulation = Manipulation(
                manipulation, nworld, self.mj_model, self.model, self.data, config.control_period, device
            )
            self.increments = self._manipulation.increments
        self.views = Views(
            qpos=wp.to_torch(self.data.qpos),
            qvel=wp.to_torch(self.data.qvel),
            site_pos=wp.to_torch(self.data.site_xpos),
            action=wp.to_torch(self.action),
            target=wp.to_torch(self.target),
            mode=wp.to_torch(self.mode),
            base_velocity=wp.to_torch(self.base_velocity),
            part_contacts=wp.to_torch(self.contacts.parts),
            self_contact=wp.to_torch(self.contacts.self_contact),
        )

    @property
    def object(self) -> ObjectState:
        """The object to grasp.

        Raises:
            RuntimeError: The simulation has none.
        """
        return self._require_manipulation().object

    @property
    def grasp(self) -> GraspForces:
        """Forces of the last control step.

        Raises:
            RuntimeError: The simulation has no object.
        """
        return self._require_manipulation().grasp

    def _require_manipulation(self) -> Manipulation:
        if self._manipulation is None:
            raise RuntimeError("this simulation was made without manipulation")
        return self._manipulation

    def advance(self) -> None:
        """Run one control step: set targets; drive, move obstacles and step physics; read contacts.

        A flag is set if there was contact in any substep. mujoco_warp finds contacts at the start of a
        substep, so what begins in the last one shows in the next control step.
        """
        clear_part_contacts(self.contacts.parts, self.contacts.self_contact)
        if self._manipulation is not None:
            self._manipulation.grasp.clear()
        set_targets(
            self.limits,
            self.increments,
            mode=self.mode,
            speed_scale=self.dynamics.speed_scale,
            action=self.action,
            qpos=self.data.qpos,
            base_target=self._base_target,
            target=self.target,
        )
        for _ in range(self.config.substeps):
            drive_module.drive(
                self.limits,
                self.config.timestep,
                lag=self.dynamics.lag,
                speed_scale=self.dynamics.speed_scale,
                acceleration_scale=self.dynamics.acceleration_scale,
                base_target=self._base_target,
                target=self.target,
                qpos=self.data.qpos,
                base_velocity=self.base_velocity,
                ctrl=self.data.ctrl,
            )
            if self._moving:
                move_slots(
                    self.layout,
                    self.data.qpos,
                    self.config.timestep,
                    self._scene_geoms,
                    self.data.geom_xpos,
                )
                if self.nearby is not None:
                    self.nearby.write()
            if self.config.kinematic:
                kinematic_step(self.model, self.data, self.config.timestep)
            else:
                mjw.step(self.model, self.data)
            part_contacts(
                self.data.contact.geom,
                self.data.contact.worldid,
                self.data.contact.dist,
                self.data.contact.type,
                self.data.nacon,
                self._geom_part,
                self._geom_is_scene,
                part_out=self.contacts.parts,
                self_out=self.contacts.self_contact,
            )
            if self._manipulation is not None:
                self._manipulation.grasp.add_substep(self.data)

    def reset(self, mask: wp.array) -> None:
        """Put the masked worlds at their layout's start state and scene; the others are left alone.

        Args:
            mask: Worlds to reset, shape (nworld,), bool.
        """
        if self._moving:
            restart_motion(self.layout, mask)
        write_geoms(self.layout, self._scene_geoms, self._geoms, mask)
        mjw.reset_data(self.model, self.data, reset=mask)
        set_start_state(
            self.limits,
            mask,
            start=self.layout.start,
            start_joints=self.layout.start_joints,
            qpos=self.data.qpos,
            base_velocity=self.base_velocity,
            target=self.target,
            action=self.action,
        )
        if self._manipulation is not None:
            self._manipulation.reset(mask, self.data, self.mode, self.action)

    def forward(self) -> None:
        """Bring poses of bodies, geoms and sites, and what is nearby, in line with the current positions."""
        mjw.kinematics(self.model, self.data)
        if self.nearby is not None:
            self.nearby.update()
