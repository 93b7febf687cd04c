# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportCallIssue=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""A planner over what the camera has seen: the policy gets a point of the way to the goal for the goal.

What was never seen counts as free, so that the robot drives on to look, and turns back where a way ends. The
map is forgotten with the episode.
"""

import torch
import warp as wp

from spin_rl.planning.distance_field import DistanceField, GridSpec
from spin_rl.sensors.interface import Sensor
from spin_rl.sensors.memory import SeenThings
from spin_rl.tasks.nav.config import PlannerConfig
from spin_rl.warp_kernels.distance_field.field import UNREACHABLE, Field, field_at
from spin_rl.warp_kernels.distance_field.subgoal import look_ahead
from spin_rl.warp_kernels.memory import recall_all
from spin_rl.warp_kernels.slots import Slots

_BEYOND_M = 1.5
"""Ways from around the robot are known where they, with the straight line to their beginning, are longer than
its own by no more than so much."""

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _begin(
    mask: wp.array[wp.bool],
    qpos: wp.array2d[float],
    goal: wp.array[wp.vec2],
    size: wp.vec2,
    # Out
    field: Field,
    planned_at_out: wp.array[int],
) -> None:
    """Put the grid around start and goal of the masked worlds' new episodes."""
    w = wp.tid()
    if mask[w]:
        planned_at_out[w] = -1
        field.origin[w] = 0.5 * (wp.vec2(qpos[w, 0], qpos[w, 1]) + goal[w] - size)


@wp.kernel
def _choose(
    qpos: wp.array2d[float],
    goal: wp.array[wp.vec2],
    field: Field,
    step: wp.array[int],
    wait: int,
    # In and out
    changed: wp.array[wp.bool],
    planned_at: wp.array[int],
    # Out
    mask_out: wp.array[wp.bool],
    near_out: wp.array[int],
) -> None:
    """Choose the worlds to plan in: new episodes and goals, in time those where something new was seen."""
    w = wp.tid()
    at = wp.vec2(qpos[w, 0], qpos[w, 1])
    is_new = planned_at[w] < 0 or wp.length(goal[w] - field.goal[w]) > 0.0
    is_due = changed[w] or field_at(field, w, at[0], at[1]) >= UNREACHABLE
    mask_out[w] = is_new or (is_due and step[w] - planned_at[w] >= wait)
    if mask_out[w]:
        changed[w] = False
        planned_at[w] = step[w]
        rows = field.values.shape[1]
        columns = field.values.shape[2]
        cell = (at - field.origin[w]) / field.cell
        row = wp.clamp(int(cell[1]), 1, rows - 2)
        near_out[w] = row * columns + wp.clamp(int(cell[0]), 1, columns - 2)


class Planner(Sensor):
    """Finds the shortest ways through what was seen, in all worlds.

    Attributes:
        subgoal: The point of the way that is ahead, or the goal where it is nearer or no way is known [m], a
            view, shape (nworld, 2).
    """

    def __init__(
        self, seen: SeenThings, qpos: wp.array, goal: wp.array, cfg: PlannerConfig, period: float
    ) -> None:
        """Allocate its map.

        Args:
            seen: What the robot remembers; updated before the planner is.
            qpos: State of the robot, shape (nworld, nq).
            goal: Goals [m], shape (nworld,), vec2.
            cfg: How it plans.
            period: Control period [s].
        """
        self._seen = seen
        self._qpos = qpos
        self._goal = goal
        self._ahead_m = cfg.ahead_m
        self._wait = max(round(cfg.replan_s / period), 1)
        nworld = goal.shape[0]
        with wp.ScopedDevice(goal.device):
            self._known = _slots_like(seen.obstacles)
            self._planned_at = wp.full(nworld, -1, dtype=wp.int32)
            self._mask = wp.zeros(nworld, dtype=bool)
            self._subgoal = wp.zeros(nworld, dtype=wp.vec2)
        self._distance_field = DistanceField(
            self._known,
            str(goal.device),
            GridSpec.square(cfg.size_m, cfg.cell_m),
            clearance_m=cfg.clearance_m,
            blocked_m=cfg.blocked_m,
            beyond_m=_BEYOND_M,
        )
        self.subgoal: torch.Tensor = wp.to_torch(self._subgoal)

    @property
    def field(self) -> Field:
        """Lengths of the ways, for kernels, around the robot's own."""
        return self._distance_field.field

    def begin(self, mask: wp.array) -> None:
        """Forget the last episode's map in the masked worlds, shape (nworld,), bool."""
        grid = self._distance_field.grid
        wp.launch(
            _begin,
            dim=mask.shape[0],
            inputs=[mask, self._qpos, self._goal, wp.vec2(grid.nx * grid.cell_m, grid.ny * grid.cell_m)],
            outputs=[self.field, self._planned_at],
            device=mask.device,
        )

    def update(self) -> None:
        """Plan where there is news, and look ahead along the ways in all worlds; graph-safe."""
        memory = self._seen.memory
        wp.launch(
            _choose,
            dim=self._mask.shape[0],
            inputs=[self._qpos, self._goal, self.field, memory.step, self._wait],
            outputs=[memory.changed, self._planned_at, self._mask, self._distance_field.near],
            device=self._mask.device,
        )
        recall_all(self._mask, memory, self._seen.obstacles, self._known)
        self._distance_field.update(self._goal, self._mask)
        look_ahead(self.field, self._qpos, self._goal, self._ahead_m, subgoal_out=self._subgoal)


def _slots_like(slots: Slots) -> Slots:
    """Make as many slots, all of them boxes that do not exist."""
    made = Slots()
    for name in ("pos", "yaw", "half_size", "active"):
        setattr(made, name, wp.zeros_like(getattr(slots, name)))
    made.is_cylinder = wp.zeros_like(slots.is_cylinder)
    return made
