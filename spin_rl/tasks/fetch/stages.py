# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportCallIssue=false
# pyright: reportIndexIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Kernels that lead a fetch from one stage to the next and end it.

Scripts tell by `ready` that their stage is done (`scripts/phases.py`); limits are in `StageLimits`.
"""

import warp as wp

from spin_rl import robot
from spin_rl.deploy.fetch.numbers import LOOSE_N, LOOSE_STEPS, RELEASE_PHASE, REST_SPEED
from spin_rl.sim.object_start import hold_still
from spin_rl.sim.targets import ABSOLUTE, INCREMENTAL, Increments
from spin_rl.tasks.common.episode import (
    COLLISION,
    NON_FINITE,
    RUNNING,
    SUCCESS,
    TIMEOUT,
    StepEnd,
    keep_state,
    put_outcome,
)
from spin_rl.tasks.fetch.state import (
    ALIGN,
    CARRY,
    PICK,
    PLACE,
    REACH,
    RETRACT,
    Bodies,
    FetchRecord,
    FetchRules,
    FetchState,
)
from spin_rl.tasks.pick.episode import DROPPED, Forces, is_lifted

_OBJECT = wp.constant(len(robot.DOF_NAMES))
_PITCH = wp.constant(robot.DOF_NAMES.index("wrist_pitch"))
_ROLL = wp.constant(robot.DOF_NAMES.index("wrist_roll"))

wp.set_module_options({"enable_backward": False})


@wp.func
def _object_at(w: int, b: Bodies) -> wp.vec3:
    return wp.vec3(b.qpos[w, _OBJECT], b.qpos[w, _OBJECT + 1], b.qpos[w, _OBJECT + 2])


@wp.func
def _distance_to(w: int, b: Bodies, point: wp.vec2) -> float:
    """Distance of the base from a point [m]."""
    return wp.length(wp.vec2(b.qpos[w, 0], b.qpos[w, 1]) - point)


@wp.func
def _is_on_table(w: int, at: wp.vec3, b: Bodies, rules: FetchRules) -> bool:
    """Whether the object's centre is over the table and not below its top."""
    centre = b.slots.pos[w, rules.table_slot]
    half = b.slots.half_size[w, rules.table_slot]
    c = wp.cos(b.slots.yaw[w, rules.table_slot])
    s = wp.sin(b.slots.yaw[w, rules.table_slot])
    x = c * (at[0] - centre[0]) + s * (at[1] - centre[1])
    y = c * (at[1] - centre[1]) - s * (at[0] - centre[0])
    return at[2] > centre[2] + half[2] and wp.abs(x) < half[0] and wp.abs(y) < half[1]


@wp.func
def _is_lost(w: int, at: wp.vec3, b: Bodies, rules: FetchRules) -> bool:
    """Whether the object has fallen off the table."""
    top = b.slots.pos[w, rules.table_slot][2] + b.slots.half_size[w, rules.table_slot][2]
    return at[2] < top - rules.fall_m


@wp.func
def _is_hit(w: int, stage: int, b: Bodies, forces: Forces, rules: FetchRules) -> bool:
    """Whether the robot touches what it must not: anything while it drives, else with force."""
    if stage == REACH or stage == CARRY:
        touched = bool(False)
        for part in range(b.parts.shape[1]):
            if b.parts[w, part]:
                touched = True
        return touched
    return forces.hard[w] > rules.hard_force_n


@wp.func
def _retry(w: int, rules: FetchRules, state: FetchState) -> int:
    """The stage after a failed attempt: another one, or -1."""
    if state.retries[w] >= rules.retries:
        return -1
    state.retries[w] = state.retries[w] + 1
    return ALIGN


@wp.func
def _after_pick(w: int, b: Bodies, forces: Forces, rules: FetchRules, state: FetchState) -> int:
    """The stage after this step of picking; -1 if the attempts are used up."""
    height = _object_at(w, b)[2] - state.rest[w]
    lifted = is_lifted(w, height, forces, rules.grasp_force_n, rules.finger_force_n, rules.lift_m)
    if forces.support[w]:
        # As it leaves the table: held like that, the object stands upright.
        state.grip[w] = wp.vec2(b.qpos[w, _PITCH], b.qpos[w, _ROLL])
    state.held[w] = wp.where(lifted, state.held[w] + 1, 0)
    if state.held[w] >= rules.hold_steps:
        state.picked[w] = True
        return RETRACT
    if state.time[w] >= rules.limits[PICK]:
        return _retry(w, rules, state)
    return PICK


@wp.func
def _is_dropped(w: int, forces: Forces, state: FetchState) -> bool:
    """Whether the fingers have lost the object for good; counts the steps without a grip."""
    loose = forces.finger[w, 0] + forces.finger[w, 1] < LOOSE_N
    state.loose[w] = wp.where(loose, state.loose[w] + 1, 0)
    return state.loose[w] >= LOOSE_STEPS


@wp.func
def _is_placed(w: int, b: Bodies, forces: Forces, rules: FetchRules, state: FetchState) -> bool:
    """Whether the object lies at rest on the floor near the robot's start."""
    at = _object_at(w, b)
    speed = wp.vec3(b.qvel[w, _OBJECT], b.qvel[w, _OBJECT + 1], b.qvel[w, _OBJECT + 2])
    low = at[2] < 1.1 * wp.length(b.half_extents[w])
    near = wp.length(wp.vec2(at[0], at[1]) - state.home[w]) < rules.place_m
    return state.ready[w] and low and near and forces.support[w] and wp.length(speed) < REST_SPEED


@wp.func
def _enter(
    w: int,
    stage: int,
    b: Bodies,
    increments: Increments,
    state: FetchState,
    mode: wp.array[int],
    action: wp.array2d[float],
) -> None:
    """Begin a stage."""
    state.stage[w] = stage
    state.time[w] = 0
    state.phase[w] = 0
    state.phase_time[w] = 0
    state.ready[w] = False
    state.held[w] = 0
    state.loose[w] = 0
    state.stuck[w] = 0
    state.detour[w] = False
    state.mark[w] = b.target[w, 0]
    mode[w] = ABSOLUTE
    if stage == ALIGN:
        state.stand[w] = wp.vec3(b.goal[w][0], b.goal[w][1], 0.0)
        if state.retries[w] > 0:
            state.is_found[w] = False
    if stage == CARRY:
        b.goal[w] = state.home[w]
    if stage == PICK:
        mode[w] = INCREMENTAL
        state.stand[w] = wp.vec3(state.stand[w][0], state.stand[w][1], b.qpos[w, 2])
        # As at the start of a pick episode: the object's place and the action that holds the pose.
        at = state.found[w]
        b.object_start[w] = wp.vec4(at[0], at[1], at[2], b.object_start[w][3])
        state.rest[w] = _object_at(w, b)[2]
        hold_still(w, b.qpos, increments, action)


@wp.kernel
def advance_stages(
    # In
    b: Bodies,
    forces: Forces,
    rules: FetchRules,
    increments: Increments,
    seen: wp.array(dtype=bool),
    # In and out
    state: FetchState,
    record: FetchRecord,
    mode: wp.array(dtype=wp.int32),
    action: wp.array2d(dtype=float),
    # Out
    end: StepEnd,
) -> None:
    """Describe the control step just made, move on to next stages and end fetches, one thread per world."""
    w = wp.tid()
    stage = state.stage[w]
    if state.length[w] == 0:
        # Not at the reset: until here they tell how the last fetch went.
        state.reached[w] = False
        state.picked[w] = False
    state.time[w] = state.time[w] + 1
    state.length[w] = state.length[w] + 1
    state.stage_steps[w, stage] = state.stage_steps[w, stage] + 1
    finite = keep_state(w, b.qpos, b.qvel, action, end)

    outcome = RUNNING
    after = stage
    at = _object_at(w, b)
    if stage == CARRY and forces.support[w]:
        state.scrapes[w] = state.scrapes[w] + 1
    if not finite:
        outcome = NON_FINITE
        at = wp.vec3(0.0, 0.0, 0.0)
    elif _is_hit(w, stage, b, forces, rules):
        outcome = COLLISION
    elif stage == REACH:
        if _distance_to(w, b, b.goal[w]) < rules.goal_tolerance_m:
            state.reached[w] = True
            after = ALIGN
    elif stage == ALIGN:
        if _is_lost(w, at, b, rules):
            outcome = DROPPED
        elif state.ready[w] and (seen[w] or not rules.must_see):
            after = PICK
    elif stage == PICK:
        if _is_lost(w, at, b, rules):
            outcome = DROPPED
        else:
            after = _after_pick(w, b, forces, rules, state)
            if after < 0:
                outcome = TIMEOUT
    elif stage == PLACE and state.phase[w] >= RELEASE_PHASE:
        if _is_placed(w, b, forces, rules, state):
            outcome = SUCCESS
    elif _is_dropped(w, forces, state):
        state.drops[w] = state.drops[w] + 1
        outcome = DROPPED
        if stage == RETRACT and _is_on_table(w, at, b, rules):
            after = _retry(w, rules, state)
            if after >= 0:
                outcome = RUNNING
    elif stage == RETRACT:
        if state.ready[w]:
            after = CARRY
    elif stage == CARRY:
        if _distance_to(w, b, b.goal[w]) < rules.home_tolerance_m:
            after = PLACE
    if outcome == RUNNING and after == stage and state.time[w] >= rules.limits[stage]:
        outcome = TIMEOUT
    if outcome == RUNNING and state.length[w] >= rules.episode_steps:
        outcome = TIMEOUT

    put_outcome(w, outcome, end)
    if outcome != RUNNING:
        if record.outcome[w] == RUNNING:
            _write_record(w, outcome, stage, at, b, state, record)
    elif after != stage:
        _enter(w, after, b, increments, state, mode, action)


@wp.func
def _write_record(
    w: int, outcome: int, stage: int, at: wp.vec3, b: Bodies, state: FetchState, record: FetchRecord
) -> None:
    record.outcome[w] = outcome
    record.stage[w] = stage
    record.kind[w] = b.object_kind[w]
    for i in range(record.steps.shape[1]):
        record.steps[w, i] = state.stage_steps[w, i]
    record.reached[w] = state.reached[w]
    record.picked[w] = state.picked[w]
    record.retries[w] = state.retries[w]
    record.drops[w] = state.drops[w]
    record.scrapes[w] = state.scrapes[w]
    record.distance[w] = wp.length(wp.vec2(at[0], at[1]) - state.home[w])
    for part in range(record.parts.shape[1]):
        record.parts[w, part] = b.parts[w, part]
