# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""The scripts of a fetch, phase by phase: align, retract and place.

A script is a row of phases; each commands base speeds and joint targets, and ends when they are reached.
All they read is in `Known`, and in their own memory: the object's place as the camera saw it last, among
others.
"""

import warp as wp

from spin_rl import robot
from spin_rl.deploy.fetch.numbers import (
    ABOVE_M,
    ASIDE_M,
    BACK_M,
    BASE_SWEEP,
    CARRY_RATE,
    DEEPEN_RATE,
    DEEPEST_PITCH,
    DETOUR_M,
    FAR_SIDE_M,
    HOMING_S,
    LOOK_TILT,
    LOWER_RATE,
    NEAR_M,
    OPEN,
    OPENING_STEPS,
    PICK_PITCH,
    PLACE_ARM_M,
    PLACE_LIFT_M,
    PLACE_SPREAD,
    PLACE_YAW,
    RAISE_M,
    RELEASE_PHASE,
    SETTLE,
    STAND_M,
    TURN_TOLERANCE,
    UP_M,
)
from spin_rl.scenes.tabletops.start_pose import lift_of
from spin_rl.tasks.fetch.known import Known
from spin_rl.tasks.fetch.scripts.moves import (
    ARM,
    FINGER,
    LIFT,
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
from spin_rl.tasks.fetch.state import ALIGN, RETRACT, FetchState

_LIFT_MAX = wp.constant(robot.JOINT_UPPER[0])

wp.set_module_options({"enable_backward": False})


@wp.func
def align(
    w: int,
    c: Command,
    known: Known,
    grip: float,
    state: FetchState,
    period: float,
    turns_to_look: bool,
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
        c.joints[LIFT] = wp.max(c.joints[LIFT] - LOWER_RATE * period, 0.0)
        return c
    c.joints[FINGER] = OPEN
    if phase == 0:
        if state.is_found[w]:
            c = look(c, base, at)
            c.done = state.time[w] >= SETTLE
        elif turns_to_look:
            # The other way where it was kept from turning.
            c.turn = wp.where(state.detour[w], -BASE_SWEEP, BASE_SWEEP)
        else:
            c = sweep(c, state.time[w], period)
        return c
    c = look(c, base, at)
    if phase == 1:
        c.joints[LIFT] = wp.clamp(lift_of(at[2] + ABOVE_M, -PICK_PITCH), 0.0, _LIFT_MAX)
    elif phase == 2:
        c.joints[ARM] = 0.0
    elif phase == 3:
        c = fold(c)
    elif phase == 4:
        spot = wp.vec2(at[0], at[1]) - STAND_M * along
        if state.detour[w]:
            spot -= DETOUR_M * along
        c = drive_to(c, base, spot)
        if state.detour[w] and c.done:
            state.detour[w] = False
            c.done = False
    elif phase == 5:
        off = wrapped(wp.atan2(at[1] - base[1], at[0] - base[0]) - base[2] + 0.5 * wp.pi)
        c.turn = wp.clamp(2.0 * off, -0.8, 0.8)
        c.done = wp.abs(off) < TURN_TOLERANCE and wp.abs(known.turning[w]) < 0.1
    elif phase == 6:
        c.joints[YAW] = 0.0
        c.joints[PITCH] = PICK_PITCH
        c.joints[ROLL] = 0.0
    else:
        # Unfolded, but the object is out of sight: look around again.
        if state.phase_time[w] > SETTLE and not turns_to_look:
            c = sweep(c, state.phase_time[w], period)
    return c


@wp.func
def retract(w: int, c: Command, known: Known, grip: float, state: FetchState) -> Command:
    """Lift the object further, arm in, back to the middle of the corridor, and take it over the base."""
    base = known.base[w]
    phase = state.phase[w]
    stand = state.stand[w]
    c.rate = CARRY_RATE
    c.joints[FINGER] = grip
    if phase == 0:
        c.joints[LIFT] = wp.min(state.mark[w] + RAISE_M, _LIFT_MAX)
    elif phase == 1:
        c.joints[ARM] = 0.0
    elif phase == 2:
        off = wrapped(stand[2] - base[2])
        c.turn = wp.clamp(2.0 * off, -0.6, 0.6)
        c.done = wp.abs(off) < 2.0 * TURN_TOLERANCE and wp.abs(known.turning[w]) < 0.1
    elif phase == 3:
        # The gripper turns ahead of the robot, which needs more room there than behind.
        ahead = (stand[0] - base[0]) * wp.cos(base[2]) + (stand[1] - base[1]) * wp.sin(base[2]) - BACK_M
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
    c.rate = CARRY_RATE
    c.joints[PAN] = 0.0
    c.joints[TILT] = LOOK_TILT
    c.joints[FINGER] = wp.where(phase < RELEASE_PHASE, grip, OPEN)
    if phase == 0:
        # The corridor begins along +x, its middle is y = 0; the hand will be on the side of +y.
        spot = wp.vec2(state.home[w][0], wp.clamp(state.home[w][1], -FAR_SIDE_M, 0.5 * ASIDE_M))
        off_spot = wp.length(wp.vec2(base[0], base[1]) - spot)
        if off_spot > ASIDE_M and float(state.time[w]) * period < HOMING_S:
            c = drive_to(c, base, spot)
            c.done = False
        else:
            off = wrapped(wp.pi - base[2])
            c.turn = wp.clamp(2.0 * off, -0.6, 0.6)
            c.done = wp.abs(off) < 2.0 * TURN_TOLERANCE
        c.joints[LIFT] = wp.max(c.joints[LIFT], PLACE_LIFT_M)
    elif phase == 1:
        c.joints[LIFT] = wp.max(c.joints[LIFT], PLACE_LIFT_M)
        c.joints[ARM] = PLACE_ARM_M
    elif phase == 2:
        # As it stood on the table.
        c.joints[YAW] = PLACE_YAW + wp.clamp(state.grip[w][0] + PLACE_SPREAD, -0.6, 0.0)
        c.joints[PITCH] = state.grip[w][0]
        c.joints[ROLL] = state.grip[w][1]
    elif phase == 3:
        c.done = known.supported[w]
        if not known.supported[w]:
            if c.joints[LIFT] > 0.0:
                c.joints[LIFT] = wp.max(c.joints[LIFT] - LOWER_RATE * period, 0.0)
            else:
                c.joints[PITCH] = wp.max(c.joints[PITCH] - DEEPEN_RATE * period, DEEPEST_PITCH)
    elif phase == 4:
        c.done = state.phase_time[w] >= OPENING_STEPS
        state.mark[w] = c.joints[LIFT]
    elif phase == 5:
        c.joints[LIFT] = state.mark[w] + UP_M
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
