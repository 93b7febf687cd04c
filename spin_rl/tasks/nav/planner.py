# pyright: reportGeneralTypeIssues=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""A planner over what the camera has seen: the policy gets a point of the way to the goal as its goal."""

from __future__ import annotations

import torch
import warp as wp

from spin_rl.planning.distance_field import DistanceField, GridSpec
from spin_rl.sensors.interface import Sensor
from spin_rl.sensors.memory import SeenThings
from spin_rl.tasks.nav.planner_kernels import begin_plans, choose_worlds
from spin_rl.warp_kernels.distance_field.subgoal import look_ahead
from spin_rl.warp_kernels.memory import recall_all
from spin_rl.warp_kernels.slots import Slots


class Planner(Sensor):
    """Plans on a map of what was seen; what was not seen counts as free."""

    def __init__(self, seen: SeenThings, qpos: wp.array, goal: wp.array, cfg, period: float, device: str) -> None:
        self._seen = seen
        self._qpos = qpos
        self._goal = goal
        self._ahead_m = cfg.ahead_m
        self._every = max(round(cfg.replan_s / period), 1)
        slots = seen.slots
        n = goal.shape[0]
        with wp.ScopedDevice(device):
            self._known = Slots()
            self._known.pos = wp.zeros_like(slots.pos)
            self._known.yaw = wp.zeros_like(slots.yaw)
            self._known.half_size = wp.zeros_like(slots.half_size)
            self._known.active = wp.zeros_like(slots.active)
            self._known.is_cylinder = wp.zeros(slots.pos.shape[1], dtype=bool)
            self._wait = wp.zeros(n, dtype=wp.int32)
            self._near = wp.zeros(n, dtype=wp.int32)
            self._mask = wp.zeros(n, dtype=bool)
            self._subgoal = wp.zeros(n, dtype=wp.vec2)
        cells = round(cfg.size_m / cfg.cell_m)
        self._field = DistanceField(self._known, device, GridSpec(cells, cells, cfg.cell_m), blocked_m=cfg.blocked_m, clearance_m=cfg.clearance_m)
        self.subgoal: torch.Tensor = wp.to_torch(self._subgoal)

    def begin(self, mask: wp.array) -> None:
        wp.launch(
            begin_plans,
            dim=mask.shape[0],
            inputs=[mask, self._qpos, self._goal, self._field.grid.nx * self._field.grid.cell_m],
            outputs=[self._field.field, self._wait],
            device=mask.device,
        )

    def update(self) -> None:
        recall_all(self._seen.memory, self._seen.slots, self._known)
        wp.launch(
            choose_worlds,
            dim=self._mask.shape[0],
            inputs=[self._every, self._qpos, self._field.field, self._goal, self._field.field.goal],
            outputs=[self._seen.memory.changed, self._wait, self._mask, self._near],
            device=self._mask.device,
        )
        self._field.update(self._goal, self._mask, self._near, 1.5)
        look_ahead(self._field.field, self._qpos, self._goal, self._ahead_m, subgoal_out=self._subgoal)
