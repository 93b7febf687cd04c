# pyright: reportGeneralTypeIssues=false
# (to a type checker, a Warp struct is an object, not a class)
"""A guard between policy and base, by what the camera has seen; see ``spin_rl.warp_kernels.guard``."""

from __future__ import annotations

import torch
import warp as wp

from spin_rl import robot
from spin_rl.sensors.clearance import robot_shapes
from spin_rl.sensors.memory import SeenThings
from spin_rl.sim.simulation import Simulation
from spin_rl.tasks.nav.config import GuardConfig
from spin_rl.warp_kernels import guard
from spin_rl.warp_kernels.slots import slots_of

HULLS = {"base": 0, "mast": 1, "head": 1, "arm": 2, "wrist": 3, "gripper": 3}


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
        shapes = robot_shapes(sim.mj_model, sim.device)
        names = [sim.mj_model.geom(int(geom)).name for geom in shapes.geom.numpy()]
        self._shapes = guard.Shapes()
        self._shapes.geom = shapes.geom
        self._shapes.half_size = shapes.half_size
        self._shapes.radius = shapes.radius
        num_worlds, k = sim.layout.nearby.shape
        self._things = guard.Things()
        with wp.ScopedDevice(sim.device):
            self._shapes.hull = wp.array([HULLS[name.partition("_")[0]] for name in names], dtype=wp.int32)
            self._things.place = wp.zeros((num_worlds, k), dtype=wp.vec3)
            for name in ("drift", "half", "height"):
                setattr(self._things, name, wp.zeros((num_worlds, k), dtype=wp.vec2))
            self._things.hit = wp.zeros((num_worlds, k), dtype=wp.int32)
            self._things.count = wp.zeros(num_worlds, dtype=wp.int32)
            self._low = wp.zeros((num_worlds, int(guard.NUM_HULLS)), dtype=wp.vec3)
            self._high = wp.zeros_like(self._low)
            self.field = None
            self._rescue = guard.Rescue()
            for name in ("stuck", "left", "hold"):
                setattr(self._rescue, name, wp.zeros(num_worlds, dtype=wp.int32))
            self._rescue.place = wp.zeros(num_worlds, dtype=wp.vec2)
            self._rescue.command = wp.zeros(num_worlds, dtype=wp.vec2)
            self._guarded = wp.zeros(num_worlds, dtype=bool)
        self.guarded: torch.Tensor = wp.to_torch(self._guarded)
        self._drive = guard.Drive()
        self._drive.forward = profile.forward_max
        self._drive.reverse = profile.reverse_max
        self._drive.turn = profile.turn_max
        self._drive.acceleration = profile.base_acceleration
        self._drive.turn_acceleration = profile.turn_acceleration
        self._drive.lag = cfg.lag_s

    def apply(self) -> None:
        """Look at the actions that the simulation is about to follow; graph-safe."""
        sim = self._sim
        guard.measure_hulls(
            self._shapes, sim.data.geom_xpos, sim.data.geom_xmat, sim.data.qpos, self._low, self._high
        )
        guard.guard(
            self._slots,
            sim.layout.nearby,
            self._memory,
            qpos=sim.data.qpos,
            velocity=sim.base_velocity,
            speed_scale=sim.dynamics.speed_scale,
            hull_low=self._low,
            hull_high=self._high,
            drive=self._drive,
            steps=self._steps,
            margin=self._margin,
            things=self._things,
            field=self.field,
            rescue=self._rescue,
            action=sim.action,
            guarded_out=self._guarded,
        )
