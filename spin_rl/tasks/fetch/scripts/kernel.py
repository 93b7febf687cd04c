# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportCallIssue=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""What the robot does by itself in a fetch: scripts between the policies, and a firm grip on the way back.

Phases are in `phases.py`; here their commands become actions, at limited rates.
"""

import warp as wp

from spin_rl.deploy.fetch.numbers import (
    AT_ONCE,
    CARRY_LIFT_RATE,
    GRIP_LEAD,
    MOVED,
    RATES,
    SETTLE,
    STILL,
    STUCK_STEPS,
)
from spin_rl.scenes.footprint import vec8
from spin_rl.sim.targets import ABSOLUTE, action_for, joint_target
from spin_rl.tasks.fetch.known import Known
from spin_rl.tasks.fetch.scripts.bumper import without_bumps
from spin_rl.tasks.fetch.scripts.moves import FINGER, LIFT, PAN, TILT, Command
from spin_rl.tasks.fetch.scripts.phases import align, is_pose, last_phase, place, retract
from spin_rl.tasks.fetch.state import ALIGN, CARRY, PICK, PLACE, REACH, RETRACT, FetchState

_RATES = wp.constant(vec8(*RATES))

wp.set_module_options({"enable_backward": False})


@wp.struct
class Drive:
    """The robot's limits and the control period, as scripts need them.

    `turns_to_look` makes the base look for the object, not the head.
    """

    joint_low: wp.array[float]
    joint_default: wp.array[float]
    joint_high: wp.array[float]
    base_speed: wp.array[float]
    carry_moves: wp.array[wp.bool]
    carry_lift_m: float
    pick_speed: wp.vec2
    turns_to_look: bool
    period: float


@wp.func
def _target_of(joint: int, value: float, drive: Drive) -> float:
    return joint_target(value, drive.joint_low[joint], drive.joint_default[joint], drive.joint_high[joint])


@wp.func
def _action_of(joint: int, target: float, drive: Drive) -> float:
    return action_for(target, drive.joint_low[joint], drive.joint_default[joint], drive.joint_high[joint])


@wp.func
def _carry(w: int, drive: Drive, grip: float, target: wp.array2d[float], action: wp.array2d[float]) -> None:
    """Change the navigation policy's action so that the object stays in the hand."""
    for joint in range(wp.static(6)):
        if joint == FINGER:
            action[w, joint + 2] = _action_of(joint, grip, drive)
        elif not drive.carry_moves[joint]:
            action[w, joint + 2] = _action_of(joint, target[w, joint], drive)
    most = CARRY_LIFT_RATE * drive.period
    wanted = wp.max(_target_of(LIFT, action[w, LIFT + 2], drive), drive.carry_lift_m)
    now = target[w, LIFT]
    action[w, LIFT + 2] = _action_of(LIFT, now + wp.clamp(wanted - now, -most, most), drive)


@wp.func
def _is_still(move: wp.vec2) -> bool:
    return wp.abs(move[0]) < STILL and wp.abs(move[1]) < STILL


@wp.kernel
def script_actions(
    # Parameters
    drive: Drive,
    # In
    known: Known,
    # In and out
    state: FetchState,
    action: wp.array2d(dtype=float),
) -> None:
    """Replace the actions of scripted stages, one thread per world."""
    w = wp.tid()
    stage = state.stage[w]
    if stage == REACH:
        return
    target = known.target
    grip = known.finger[w] - GRIP_LEAD
    if stage == PICK:
        # The policy does not see walls.
        speed = wp.cw_mul(drive.pick_speed, wp.vec2(action[w, 0], action[w, 1]))
        safe = wp.cw_div(without_bumps(w, known, speed[0], speed[1]), drive.pick_speed)
        action[w, 0] = safe[0]
        action[w, 1] = safe[1]
        return
    if stage == CARRY:
        _carry(w, drive, grip, target, action)
        return
    c = Command()
    c.rate = 1.0
    for joint in range(target.shape[1]):
        c.joints[joint] = target[w, joint]
    if stage == ALIGN:
        c = align(w, c, known, grip, state, drive.period, drive.turns_to_look)
    elif stage == RETRACT:
        c = retract(w, c, known, grip, state)
    elif stage == PLACE:
        c = place(w, c, known, grip, state, drive.period)

    move = without_bumps(w, known, c.forward, c.turn)
    is_stuck = _is_still(move) and not _is_still(wp.vec2(c.forward, c.turn))
    state.stuck[w] = wp.where(is_stuck, state.stuck[w] + 1, 0)
    if state.stuck[w] >= STUCK_STEPS:
        state.stuck[w] = 0
        state.detour[w] = not state.detour[w]
    action[w, 0] = move[0] / wp.where(move[0] >= 0.0, drive.base_speed[0], drive.base_speed[1])
    action[w, 1] = move[1] / drive.base_speed[2]
    moving = bool(False)
    for joint in range(target.shape[1]):
        now = target[w, joint]
        goal = wp.clamp(c.joints[joint], drive.joint_low[joint], drive.joint_high[joint])
        most = c.rate * _RATES[joint] * drive.period
        if joint == FINGER and (stage != ALIGN or goal < now):
            most = AT_ONCE
        if joint < FINGER and wp.abs(goal - now) > MOVED:
            moving = True
        action[w, joint + 2] = _action_of(joint, now + wp.clamp(goal - now, -most, most), drive)

    # Phases that only move joints are done when these have followed.
    state.phase_time[w] = wp.where(moving, 0, state.phase_time[w] + 1)
    last = last_phase(stage)
    phase = state.phase[w]
    if phase >= last:
        state.ready[w] = state.phase_time[w] >= SETTLE
    elif c.done or (is_pose(stage, phase) and state.phase_time[w] >= SETTLE):
        state.phase[w] = phase + 1
        state.phase_time[w] = 0


@wp.kernel
def hold_camera(
    # In
    mode: wp.array(dtype=wp.int32),
    hold: wp.vec2,
    # Out
    action_out: wp.array2d(dtype=float),
) -> None:
    """Replace the head's actions by those that hold a pose, one thread per world.

    ``hold`` is that of the absolute mode; in the incremental one the targets stay where they are.
    """
    w = wp.tid()
    is_absolute = mode[w] == ABSOLUTE
    action_out[w, PAN + 2] = wp.where(is_absolute, hold[0], 0.0)
    action_out[w, TILT + 2] = wp.where(is_absolute, hold[1], 0.0)
