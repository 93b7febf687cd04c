# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportCallIssue=false
# pyright: reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Kernels that end and begin picks on the device, and what they say of each control step."""

from dataclasses import dataclass

import torch
import warp as wp

from spin_rl import robot
from spin_rl.sim.manipulation import GraspForces
from spin_rl.tasks.common.episode import (
    COLLISION,
    NON_FINITE,
    OUTCOMES,
    RUNNING,
    SUCCESS,
    TIMEOUT,
    StepEnd,
    keep_state,
    move_level,
    put_outcome,
)

DROPPED = wp.constant(len(OUTCOMES))
PICK_OUTCOMES = (*OUTCOMES, "dropped")

INSIDE_M = (0.04, 0.04, 0.04)
"""An object is between the fingers if its centre is within this of the grasp centre, along the axes of the
gripper: out of it, from finger to finger, and across [m]."""

_INSIDE = wp.constant(wp.vec3(*INSIDE_M))
_OBJECT = wp.constant(len(robot.DOF_NAMES))
_LEFT = wp.constant(robot.DOF_NAMES.index("finger_left"))
_RIGHT = wp.constant(robot.DOF_NAMES.index("finger_right"))

wp.set_module_options({"enable_backward": False})


@wp.struct
class PickRules:
    """When a pick ends and what counts as one; see `PickConfig`."""

    episode_steps: int
    hold_steps: int
    lift_m: float
    grasp_force_n: float
    finger_force_n: float
    hard_force_n: float
    fall_m: float
    end_on_success: bool
    level_up: float
    level_down: float


@wp.struct
class Forces:
    """Forces of the last control step; see `GraspForces`."""

    finger: wp.array2d[float]
    table: wp.array[float]
    hard: wp.array[float]
    support: wp.array[wp.bool]


@wp.struct
class StepArrays:
    """What a control step did, before worlds that ended were reset; see `PickTransition`."""

    distance: wp.array[float]
    height: wp.array[float]
    finger: wp.array[float]
    finger_force: wp.array2d[float]
    table_force: wp.array[float]
    hard_peak: wp.array[float]
    inside: wp.array[wp.bool]
    grasped: wp.array[wp.bool]
    pressed: wp.array[wp.bool]
    success: wp.array[wp.bool]
    collision: wp.array[wp.bool]
    dropped: wp.array[wp.bool]
    time_out: wp.array[wp.bool]


@wp.struct
class Progress:
    """How far the running episode of each world is.

    `length` counts its control steps, `held` those with the object held up until now, `succeeded` tells
    whether there was a success, `hard_peak` is the largest force of a part other than the fingers on the
    scene [N].
    """

    length: wp.array[int]
    held: wp.array[int]
    succeeded: wp.array[wp.bool]
    hard_peak: wp.array[float]
    level: wp.array[float]


@wp.func
def clear_forces(w: int, forces: Forces) -> None:
    """Forget a world's forces: nothing touches anything, and the object stands."""
    forces.finger[w, 0] = 0.0
    forces.finger[w, 1] = 0.0
    forces.table[w] = 0.0
    forces.hard[w] = 0.0
    forces.support[w] = True


@wp.func
def is_grasped(w: int, forces: Forces, grasp_force: float, finger_force: float) -> bool:
    """Whether the fingertips press the object, together and each (SPIN, r_lift)."""
    left = forces.finger[w, 0]
    right = forces.finger[w, 1]
    return left + right > grasp_force and wp.min(left, right) > finger_force


@wp.func
def is_lifted(
    w: int, height: float, forces: Forces, grasp_force: float, finger_force: float, lift: float
) -> bool:
    """Whether the object is held up, `height` [m] over where it stood."""
    return height > lift and is_grasped(w, forces, grasp_force, finger_force) and not forces.support[w]


@wp.func
def _describe(
    w: int,
    offset: wp.vec3,
    height: float,
    finger: float,
    forces: Forces,
    rules: PickRules,
    out: StepArrays,
) -> None:
    """Write what the step did; `offset` is from the grasp centre to the object, in the gripper's axes."""
    left = forces.finger[w, 0]
    right = forces.finger[w, 1]
    out.distance[w] = wp.length(offset)
    out.height[w] = height
    out.finger[w] = finger
    out.finger_force[w, 0] = left
    out.finger_force[w, 1] = right
    out.table_force[w] = forces.table[w]
    inside = bool(True)
    for i in range(3):
        if wp.abs(offset[i]) > _INSIDE[i]:
            inside = False
    out.inside[w] = inside
    out.pressed[w] = left + right > rules.grasp_force_n
    out.grasped[w] = is_grasped(w, forces, rules.grasp_force_n, rules.finger_force_n)
    out.collision[w] = forces.hard[w] > rules.hard_force_n


@wp.kernel
def end_picks(
    # In
    qpos: wp.array2d(dtype=float),
    qvel: wp.array2d(dtype=float),
    action: wp.array2d(dtype=float),
    site_xpos: wp.array2d(dtype=wp.vec3),
    site_xmat: wp.array2d(dtype=wp.mat33),
    grasp_site: int,
    start_pose: wp.array(dtype=wp.vec4),
    half_extents: wp.array(dtype=wp.vec3),
    forces: Forces,
    rules: PickRules,
    # In and out
    progress: Progress,
    # Out
    out: StepArrays,
    end: StepEnd,
) -> None:
    """Describe the control step just made and end episodes, one thread per world."""
    w = wp.tid()
    progress.length[w] = progress.length[w] + 1
    outcome = RUNNING
    out.time_out[w] = False
    if not keep_state(w, qpos, qvel, action, end):
        outcome = NON_FINITE
        clear_forces(w, forces)
        _describe(w, wp.vec3(1.0, 0.0, 0.0), 0.0, 0.0, forces, rules, out)
        out.success[w] = False
        out.dropped[w] = False
    else:
        at = wp.vec3(qpos[w, _OBJECT], qpos[w, _OBJECT + 1], qpos[w, _OBJECT + 2])
        offset = wp.transpose(site_xmat[w, grasp_site]) * (at - site_xpos[w, grasp_site])
        height = at[2] - start_pose[w][2]
        _describe(w, offset, height, 0.5 * (qpos[w, _LEFT] + qpos[w, _RIGHT]), forces, rules, out)
        lifted = is_lifted(w, height, forces, rules.grasp_force_n, rules.finger_force_n, rules.lift_m)
        progress.held[w] = wp.where(lifted, progress.held[w] + 1, 0)
        out.success[w] = progress.held[w] >= rules.hold_steps
        # Who hits something in the step of the first success has not succeeded.
        if out.success[w] and not out.collision[w]:
            progress.succeeded[w] = True
        # At the start the object stands on the table.
        out.dropped[w] = height + half_extents[w][2] < -rules.fall_m
        if out.collision[w]:
            outcome = COLLISION
        elif out.dropped[w]:
            outcome = DROPPED
        elif rules.end_on_success and out.success[w]:
            outcome = SUCCESS
        elif progress.length[w] >= rules.episode_steps:
            outcome = TIMEOUT
            out.time_out[w] = True
        if outcome != RUNNING and progress.succeeded[w]:
            outcome = SUCCESS
    progress.hard_peak[w] = wp.max(progress.hard_peak[w], forces.hard[w])
    out.hard_peak[w] = progress.hard_peak[w]
    put_outcome(w, outcome, end)
    move_level(w, outcome, rules.level_up, rules.level_down, progress.level)


@wp.kernel
def set_near_share(
    # In
    level: wp.array(dtype=float),
    start_level: float,
    first_share: float,
    last_share: float,
    # Out
    near_share_out: wp.array(dtype=float),
) -> None:
    """Set the share of near starts of every world's level, one thread per world."""
    w = wp.tid()
    way = wp.clamp((level[w] - start_level) / wp.max(1.0 - start_level, 1.0e-6), 0.0, 1.0)
    near_share_out[w] = first_share + way * (last_share - first_share)


@wp.kernel
def begin_picks(
    # In
    mask: wp.array(dtype=bool),
    # Out
    progress: Progress,
    forces: Forces,
) -> None:
    """Begin the masked worlds' episodes, one thread per world."""
    w = wp.tid()
    if not mask[w]:
        return
    progress.held[w] = 0
    progress.succeeded[w] = False
    progress.hard_peak[w] = 0.0
    clear_forces(w, forces)


@dataclass
class StepViews:
    """Torch views of `StepArrays`."""

    distance: torch.Tensor
    height: torch.Tensor
    finger: torch.Tensor
    finger_force: torch.Tensor
    table_force: torch.Tensor
    hard_peak: torch.Tensor
    inside: torch.Tensor
    grasped: torch.Tensor
    pressed: torch.Tensor
    success: torch.Tensor
    collision: torch.Tensor
    dropped: torch.Tensor
    time_out: torch.Tensor


def read_forces(grasp: GraspForces) -> Forces:
    """Make the forces that kernels read of those that the simulation measures."""
    forces = Forces()
    forces.finger, forces.table = grasp.finger_force, grasp.table_force
    forces.hard, forces.support = grasp.hard_contact, grasp.object_support
    return forces


def make_step_arrays(nworld: int, device: str) -> tuple[StepArrays, StepViews]:
    """Allocate what a control step says of every world, with Torch views."""
    arrays, views = StepArrays(), {}
    for name, var in StepArrays.vars.items():
        shape = (nworld, 2) if var.type.ndim == 2 else nworld
        array = wp.zeros(shape, dtype=var.type.dtype, device=device)
        setattr(arrays, name, array)
        views[name] = wp.to_torch(array)
    return arrays, StepViews(**views)
