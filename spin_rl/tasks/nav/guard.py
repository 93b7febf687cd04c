# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""A guard between policy and base, by what the camera has seen; see ``spin_rl.warp_kernels.guard``."""

from typing import Any

import torch
import warp as wp

from spin_rl import robot
from spin_rl.sensors.clearance import robot_shapes
from spin_rl.sensors.memory import SeenThings
from spin_rl.sim.simulation import Simulation
from spin_rl.tasks.nav.arm_guard import hold_arm, make_joints
from spin_rl.tasks.nav.config import GuardConfig
from spin_rl.warp_kernels.distance_field.field import Field
from spin_rl.warp_kernels.guard import evade, filter, hulls, recovery, trial
from spin_rl.warp_kernels.slots import slots_of

HULLS = {"base": 0, "mast": 1, "head": 1, "arm": 2, "wrist": 3, "gripper": 3}
"""Number of the box that a geom is in, by the first word of its name."""


class Guard:
    """Changes the base's actions in the simulation before a step, where they would end in a collision.

    Attributes:
        guarded: Whether it did in the last step, a view, shape (num_envs,), bool.
    """

    def __init__(
        self, sim: Simulation, seen: SeenThings, cfg: GuardConfig, profile: robot.SpeedProfile
    ) -> None:
        """Allocate its memory.

        Args:
            sim: The simulation, whose actions are changed.
            seen: What the robot remembers.
            cfg: How far it looks ahead.
            profile: Speed limits of the robot.
        """
        self._sim = sim
        self._memory = seen.memory
        self._slots = slots_of(sim.layout)
        self._steps = max(round(cfg.look_ahead_s / sim.config.control_period), 1)
        self._margin = cfg.margin_m
        self._foreseen = round(cfg.foresee_s / sim.config.control_period)
        shapes = robot_shapes(sim.mj_model, sim.device)
        names = [sim.mj_model.geom(int(geom)).name for geom in shapes.geom.numpy()]
        self._shapes = hulls.Shapes()
        self._shapes.geom = shapes.geom
        self._shapes.half_size = shapes.half_size
        self._shapes.radius = shapes.radius
        num_worlds, k = sim.layout.nearby.shape
        self._things = trial.Things()
        with wp.ScopedDevice(sim.device):
            self._shapes.hull = wp.array([HULLS[name.partition("_")[0]] for name in names], dtype=wp.int32)
            self._things.place = wp.zeros((num_worlds, k), dtype=wp.vec3)
            for name in ("drift", "half", "height"):
                setattr(self._things, name, wp.zeros((num_worlds, k), dtype=wp.vec2))
            self._things.reach = wp.zeros((num_worlds, k), dtype=float)
            self._things.gap = wp.zeros((num_worlds, k), dtype=wp.vec4)
            self._things.count = wp.zeros(num_worlds, dtype=wp.int32)
            self._low = wp.zeros((num_worlds, int(hulls.NUM_HULLS)), dtype=wp.vec3)
            self._high = wp.zeros_like(self._low)
            self._recovery_left = wp.zeros(num_worlds, dtype=wp.int32)
            self._guarded = wp.zeros(num_worlds, dtype=bool)
        self._joints = make_joints(sim, self._shapes)
        self.guarded: torch.Tensor = wp.to_torch(self._guarded)
        self._drive = trial.Drive()
        self._drive.forward = profile.forward_max
        self._drive.reverse = profile.reverse_max
        self._drive.turn = profile.turn_max
        self._drive.acceleration = profile.base_acceleration
        self._drive.turn_acceleration = profile.turn_acceleration
        self._drive.lag = cfg.lag_s
        self._recovery: dict[str, Any] | None = None

    def add_recovery(self, field: Field, stuck_s: float, episode_length: wp.array) -> None:
        """Drive out by itself from now on where the robot is stuck.

        Args:
            field: Ways to the goal through what was seen.
            stuck_s: Time after which a base that is kept from its commands in one place is stuck [s].
            episode_length: Steps that the running episode has taken, shape (num_envs,), int32.
        """
        num_worlds = episode_length.shape[0]
        state = recovery.Recovery()
        with wp.ScopedDevice(self._sim.device):
            for name in ("place", "command", "then"):
                setattr(state, name, wp.zeros(num_worlds, dtype=wp.vec2))
            state.left = self._recovery_left
            for name in ("stuck", "hold"):
                setattr(state, name, wp.zeros(num_worlds, dtype=wp.int32))
            state.has_then = wp.zeros(num_worlds, dtype=bool)
        patience = max(round(stuck_s / self._sim.config.control_period), 1)
        self._recovery = {
            "field": field,
            "patience": patience,
            "episode_length": episode_length,
            "recovery": state,
        }

    def apply(self) -> None:
        """Look at the actions that the simulation is about to follow; graph-safe."""
        sim = self._sim
        hulls.measure_hulls(
            self._shapes, sim.data.geom_xpos, sim.data.geom_xmat, sim.data.qpos, self._low, self._high
        )
        common = {
            "qpos": sim.data.qpos,
            "velocity": sim.base_velocity,
            "speed_scale": sim.dynamics.speed_scale,
            "hull_low": self._low,
            "hull_high": self._high,
            "drive": self._drive,
            "things": self._things,
            "action": sim.action,
        }
        filter.guard(
            self._slots,
            sim.layout.nearby,
            self._memory,
            **common,
            steps=self._steps,
            margin=self._margin,
            guarded_out=self._guarded,
        )
        if self._recovery is not None:
            recovery.recover(**common, **self._recovery, guarded=self._guarded)
        hold_arm(sim, self._shapes, self._joints, self._low, self._high, self._things, self._recovery_left)
        if self._foreseen > 0:
            evade.evade(**common, steps=self._foreseen, margin=self._margin, guarded=self._guarded)
