# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""The scripts of a fetch, phase by phase: align, retract and place.

A script is a row of phases; each commands base speeds and joint targets, and ends when they are reached.
All they read is in `Known`, and in their own memory: the object's place as the camera saw it last, among
others.
"""

import warp as wp

from spin_rl import robot
from spin_rl.scenes.tabletops.start_pose import lift_of
from spin_rl.tasks.fetch.known import Known
from spin_rl.tasks.fetch.scripts.moves import (
    ARM,
    FINGER,
    LIFT,
    LOOK_TILT,
    NEAR_M,
    PAN,
    PITCH,
    ROLL,
    TILT,
    YAW,
    Command,
    drive_to,
    fold,
    look,
    sweep,
    wrapped,
)
from spin_rl.tasks.fetch.state import ALIGN, RELEASE_PHASE, RETRACT, FetchState

_LIFT_MAX = wp.constant(robot.JOINT_UPPER[0])
_STAND_M = wp.constant(0.70)
"""Distance of the base from the object to pick it from; the pick task has 0.57 to 0.85 m."""
_DETOUR_M = wp.constant(0.35)
"""How far back from there the robot drives first where it has no room to turn to it."""
_TURN_TOLERANCE = wp.constant(0.04)
_ABOVE_M = wp.constant(0.12)
"""Height of the gripper over the object's centre at the start of a pick."""
_PICK_PITCH = wp.constant(-0.15)
_OPEN = wp.constant(0.45)
"""Finger angle at the start of a pick and to put down [rad]."""
_RAISE_M = wp.constant(0.1)
"""How much further the object is lifted before the arm comes in."""
# To put down: the arm extends past the base's side and the gripper points ahead of the base.
_PLACE_ARM_M = wp.constant(0.13)
_PLACE_YAW = wp.constant(1.9)
_PLACE_SPREAD = wp.constant(0.6)
"""Deeper than this pitch downwards the hand turns away from the base by as much, or a finger would hit it."""
_ASIDE_M = wp.constant(0.08)
"""How far the robot may be from the spot to put down from."""
_FAR_SIDE_M = wp.constant(0.2)
"""How far that spot may be from the middle of the corridor, on the side away from the hand."""
_HOMING_S = wp.constant(8.0)
"""Longest time to drive there [s]."""
_PLACE_LIFT_M = wp.constant(0.55)
_DEEPEST_PITCH = wp.constant(-0.9)
_BACK_M = wp.constant(0.05)
"""How far behind the middle of the corridor, across it, the robot folds the wrist."""
SETTLE = wp.constant(3)
"""Steps that joints get to follow targets that stand still."""
_OPENING_STEPS = wp.constant(10)
_LOWER_RATE = wp.constant(0.12)
_CARRY_RATE = wp.constant(0.6)
"""Part of these rates with an object in the hand."""

wp.set_module_options({"enable_backward": False})


@wp.func
def align(
    w: int,
    c: Command,
    known: Known,
    grip: float,
    state: FetchState,
    period: float,
) -> Command:
    """Find the object, get the hand out of its way, stand before it, turn beside it, and unfold."""
    base = known.base[w]
    yaw = known.table_yaw[w]
    along = wp.vec2(wp.cos(yaw), wp.sin(yaw))
    phase = state.phase[w]
    at = state.found[w]
    if known.holds[w] and phase == 0:
        # After a pick that was not one: down with it before the fingers open, and then look where it stands.
        state.is_found[w] = False
        c.joints[FINGER] = grip
        c.joints[LIFT] = wp.max(c.joints[LIFT] - _LOWER_RATE * period, 0.0)
        return c
    c.joints[FINGER] = _OPEN
    if phase == 0:
        if state.is_found[w]:
            c = look(c, base, at)
            c.done = state.time[w] >= SETTLE
        else:
            c = sweep(c, state.time[w], period)
        return c
    c = look(c, base, at)
    if phase == 1:
        c.joints[LIFT] = wp.clamp(lift_of(at[2] + _ABOVE_M, -_PICK_PITCH), 0.0, _LIFT_MAX)
    elif phase == 2:
        c.joints[ARM] = 0.0
    elif phase == 3:
        c = fold(c)
    elif phase == 4:
        spot = wp.vec2(at[0], at[1]) - _STAND_M * along
        if state.detour[w]:
            spot -= _DETOUR_M * along
        c = drive_to(c, base, spot)
        if state.detour[w] and c.done:
            state.detour[w] = False
            c.done = False
    elif phase == 5:
        off = wrapped(wp.atan2(at[1] - base[1], at[0] - base[0]) - base[2] + 0.5 * wp.pi)
        c.turn = wp.clamp(2.0 * off, -0.8, 0.8)
        c.done = wp.abs(off) < _TURN_TOLERANCE and wp.abs(known.turning[w]) < 0.1
    elif phase == 6:
        c.joints[YAW] = 0.0
        c.joints[PITCH] = _PICK_PITCH
        c.joints[ROLL] = 0.0
    else:
        # Unfolded, but the object is out of sight: look around again.
        if state.phase_time[w] > SETTLE:
            c = sweep(c, state.phase_time[w], period)
    return c


@wp.func
def retract(w: int, c: Command, known: Known, grip: float, state: FetchState) -> Command:
    """Lift the object further, arm in, back to the middle of the corridor, and take it over the base."""
    base = known.base[w]
    phase = state.phase[w]
    stand = state.stand[w]
    c.rate = _CARRY_RATE
    c.joints[FINGER] = grip
    if phase == 0:
        c.joints[LIFT] = wp.min(state.mark[w] + _RAISE_M, _LIFT_MAX)
    elif phase == 1:
        c.joints[ARM] = 0.0
    elif phase == 2:
        off = wrapped(stand[2] - base[2])
        c.turn = wp.clamp(2.0 * off, -0.6, 0.6)
        c.done = wp.abs(off) < 2.0 * _TURN_TOLERANCE and wp.abs(known.turning[w]) < 0.1
    elif phase == 3:
        # The gripper turns ahead of the robot, which needs more room there than behind.
        ahead = (stand[0] - base[0]) * wp.cos(base[2]) + (stand[1] - base[1]) * wp.sin(base[2]) - _BACK_M
        c.forward = wp.clamp(1.5 * ahead, -0.1, 0.2)
        c.done = wp.abs(ahead) < NEAR_M
    elif phase == 4:
        c = fold(c)
    return c


@wp.func
def place(w: int, c: Command, known: Known, grip: float, state: FetchState, period: float) -> Command:
    """Turn away from the corridor, hold the object ahead of the base, lower it, open, raise the hand."""
    base = known.base[w]
    phase = state.phase[w]
    c.rate = _CARRY_RATE
    c.joints[PAN] = 0.0
    c.joints[TILT] = LOOK_TILT
    c.joints[FINGER] = wp.where(phase < RELEASE_PHASE, grip, _OPEN)
    if phase == 0:
        # The corridor begins along +x, its middle is y = 0; the hand will be on the side of +y.
        spot = wp.vec2(state.home[w][0], wp.clamp(state.home[w][1], -_FAR_SIDE_M, 0.5 * _ASIDE_M))
        off_spot = wp.length(wp.vec2(base[0], base[1]) - spot)
        if off_spot > _ASIDE_M and float(state.time[w]) * period < _HOMING_S:
            c = drive_to(c, base, spot)
            c.done = False
        else:
            off = wrapped(wp.pi - base[2])
            c.turn = wp.clamp(2.0 * off, -0.6, 0.6)
            c.done = wp.abs(off) < 2.0 * _TURN_TOLERANCE
        c.joints[LIFT] = wp.max(c.joints[LIFT], _PLACE_LIFT_M)
    elif phase == 1:
        c.joints[LIFT] = wp.max(c.joints[LIFT], _PLACE_LIFT_M)
        c.joints[ARM] = _PLACE_ARM_M
    elif phase == 2:
        # As it stood on the table.
        c.joints[YAW] = _PLACE_YAW + wp.clamp(state.grip[w][0] + _PLACE_SPREAD, -0.6, 0.0)
        c.joints[PITCH] = state.grip[w][0]
        c.joints[ROLL] = state.grip[w][1]
    elif phase == 3:
        c.done = known.supported[w]
        if not known.supported[w]:
            if c.joints[LIFT] > 0.0:
                c.joints[LIFT] = wp.max(c.joints[LIFT] - _LOWER_RATE * period, 0.0)
            else:
                c.joints[PITCH] = wp.max(c.joints[PITCH] - 0.3 * period, _DEEPEST_PITCH)
    elif phase == 4:
        c.done = state.phase_time[w] >= _OPENING_STEPS
        state.mark[w] = c.joints[LIFT]
    elif phase == 5:
        c.joints[LIFT] = state.mark[w] + 0.3
    return c


@wp.func
def last_phase(stage: int) -> int:
    """The phase with which a script ends."""
    if stage == ALIGN:
        return 7
    if stage == RETRACT:
        return 4
    return 5


@wp.func
def is_pose(stage: int, phase: int) -> bool:
    """Whether a phase only moves joints."""
    if stage == ALIGN:
        return (phase >= 1 and phase <= 3) or phase == 6
    if stage == RETRACT:
        return phase <= 1
    return phase == 1 or phase == 2
