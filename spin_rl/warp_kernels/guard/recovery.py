# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportInvalidTypeForm=false
# pyright: reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportIndexIssue=false, reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""The way out for a robot that is stuck: two commands, one after the other, that bring it nearest the goal.

A policy that is kept from what it asks for may ask for it for ever. When the base has not left its place for
a while, it is driven for some seconds by the field of ways that a planner made of what was seen.
"""

import warp as wp

from spin_rl.warp_kernels.distance_field.field import Field, field_at
from spin_rl.warp_kernels.distance_field.trace import downhill
from spin_rl.warp_kernels.guard.filter import BACK_M_S, limits_of, put_command
from spin_rl.warp_kernels.guard.trial import Drive, Motion, Things, Trial, drive_on, is_free, trial_of

_MOVED_M = wp.constant(0.15)
"""A base that got so far from where it was is not stuck [m]."""
_RECOVERY_STEPS = wp.constant(40)
"""Steps that a recovery takes."""
_FIRST_STEPS = wp.constant(8)
"""Steps of the first command."""
_BACK_STEPS = wp.constant(24)
"""Steps of a first command that leads backwards, which is slow."""
_SECOND_STEPS = wp.constant(10)
"""Steps of the second command."""
_TURNS = wp.constant(7)
"""Turning speeds that are tried: none, and parts of the limit to either side."""
_SLOW_M_S = wp.constant(0.3)
"""Speed that is tried ahead [m/s]."""
_HEADING_M = wp.constant(0.3)
"""Way that turning by 1 rad is worth [m]."""
_STAY_M = wp.constant(0.05)
_STAY_RAD = wp.constant(0.2)
"""Commands that move the base less than this, and turn it less, lead out of nothing."""
_FAR = wp.constant(1.0e9)

wp.set_module_options({"enable_backward": False, "max_unroll": 1})  # unrolled, CUDA takes minutes to compile


@wp.struct
class Recovery:
    """Who is stuck, and what is done there; arrays (nworld,).

    ``place`` is where the base was when it counted as moving last, ``stuck`` how many steps ago that was,
    twice for steps in which it was kept from what was asked for. ``left`` are steps of a recovery that are
    left, ``hold`` those of its ``command`` [m/s, rad/s], which ``then`` follows.
    """

    place: wp.array[wp.vec2]
    stuck: wp.array[int]
    left: wp.array[int]
    hold: wp.array[int]
    command: wp.array[wp.vec2]
    then: wp.array[wp.vec2]
    has_then: wp.array[wp.bool]


@wp.func
def _left_to_go(world: int, pose: wp.vec3, base: wp.vec3, field: Field) -> float:
    """Way from a pose in the base frame, with what it costs to turn along it [m]."""
    cos_yaw = wp.cos(base[2])
    sin_yaw = wp.sin(base[2])
    at = wp.vec2(
        base[0] + cos_yaw * pose[0] - sin_yaw * pose[1], base[1] + sin_yaw * pose[0] + cos_yaw * pose[1]
    )
    along = downhill(field, world, at)
    turn = wp.atan2(along[1], along[0]) - base[2] - pose[2]
    return field_at(field, world, at[0], at[1]) + _HEADING_M * wp.abs(wp.atan2(wp.sin(turn), wp.cos(turn)))


@wp.func
def _turn(index: int, limit: float) -> float:
    """One of `_TURNS` turning speeds."""
    side = index - _TURNS // 2
    part = wp.where(wp.abs(side) == 1, 0.2, 0.5)
    part = wp.where(wp.abs(side) == 3, 1.0, part)
    return part * limit * wp.sign(float(side)) * wp.where(side == 0, 0.0, 1.0)


@wp.func
def _way_out(
    world: int, now: wp.vec2, base: wp.vec3, limit: wp.vec3, trial: Trial, field: Field, recovery: Recovery
) -> None:
    """Set two commands, one after the other, that hit nothing and end nearest to the goal."""
    recovery.command[world] = wp.vec2(0.0, 0.0)
    recovery.then[world] = wp.vec2(0.0, 0.0)
    recovery.hold[world] = _FIRST_STEPS
    recovery.has_then[world] = False
    least = float(_FAR)
    slow = wp.min(limit[0], _SLOW_M_S)
    back = -wp.min(limit[1], BACK_M_S)
    start = Motion()
    start.speed = now
    for i in range(4 * _TURNS):
        v = wp.where(i // _TURNS == 0, slow, wp.where(i // _TURNS == 1, 0.0, back))
        first = wp.vec2(v, _turn(i % _TURNS, limit[2]))
        steps = wp.where(i // _TURNS == 3, _BACK_STEPS, _FIRST_STEPS)
        middle = drive_on(world, start, first, 0, steps, trial)
        if not middle.hit:
            for j in range(2 * _TURNS):
                then = wp.vec2(wp.where(j // _TURNS == 0, slow, 0.0), _turn(j % _TURNS, limit[2]))
                end = drive_on(world, middle, then, steps, _SECOND_STEPS, trial)
                moved = wp.length(wp.vec2(end.pose[0], end.pose[1])) > _STAY_M
                if not end.hit and (moved or wp.abs(end.pose[2]) > _STAY_RAD):
                    cost = _left_to_go(world, end.pose, base, field)
                    if cost < least:
                        least = cost
                        recovery.command[world] = first
                        recovery.then[world] = then
                        recovery.hold[world] = steps
                        recovery.has_then[world] = True


@wp.func
def _is_stuck(
    world: int, here: wp.vec2, begins: bool, guarded: bool, patience: int, recovery: Recovery
) -> bool:
    """Count the steps since a base has left its place, and say whether they are too many."""
    if begins or wp.length(here - recovery.place[world]) > _MOVED_M:
        recovery.place[world] = here
        recovery.stuck[world] = 0
    else:
        recovery.stuck[world] = recovery.stuck[world] + wp.where(guarded, 2, 1)
    return recovery.stuck[world] >= 2 * patience


@wp.kernel
def _recover(
    episode_length: wp.array[int],
    qpos: wp.array2d[float],
    velocity: wp.array2d[float],
    speed_scale: wp.array[float],
    hull_low: wp.array2d[wp.vec3],
    hull_high: wp.array2d[wp.vec3],
    drive: Drive,
    things: Things,
    field: Field,
    patience: int,
    recovery: Recovery,
    action: wp.array2d[float],
    guarded: wp.array[wp.bool],
):
    world = wp.tid()
    base = wp.vec3(qpos[world, 0], qpos[world, 1], qpos[world, 2])
    begins = episode_length[world] == 0
    if begins:
        recovery.left[world] = 0
    is_stuck = _is_stuck(world, wp.vec2(base[0], base[1]), begins, guarded[world], patience, recovery)
    if is_stuck and recovery.left[world] == 0:
        recovery.stuck[world] = 0
        recovery.left[world] = _RECOVERY_STEPS
        recovery.hold[world] = 0
        recovery.has_then[world] = False
    if recovery.left[world] == 0:
        return
    # No margin: it drives slowly, and may have got into a place where a margin leaves no way.
    trial = trial_of(world, hull_low, hull_high, drive, things, 0.0)
    limit = limits_of(drive, speed_scale[world])
    now = wp.vec2(velocity[world, 0], velocity[world, 1])
    if recovery.hold[world] == 0 and recovery.has_then[world]:
        recovery.command[world] = recovery.then[world]
        recovery.hold[world] = _SECOND_STEPS
        recovery.has_then[world] = False
    if recovery.hold[world] == 0 or not is_free(world, now, recovery.command[world], 2, trial):
        _way_out(world, now, base, limit, trial, field, recovery)
    recovery.hold[world] = recovery.hold[world] - 1
    recovery.left[world] = recovery.left[world] - 1
    guarded[world] = True
    to = recovery.command[world]
    if not is_free(world, now, to, 1, trial):
        to = wp.vec2(0.0, 0.0)
    put_command(world, to, limit, action)


def recover(
    *,
    episode_length: wp.array,
    qpos: wp.array,
    velocity: wp.array,
    speed_scale: wp.array,
    hull_low: wp.array,
    hull_high: wp.array,
    drive: Drive,
    things: Things,
    field: Field,
    patience: int,
    recovery: Recovery,
    action: wp.array,
    guarded: wp.array,
) -> None:
    """Replace base actions of robots that are stuck; graph-safe, after `filter.guard` with the same things.

    Args:
        episode_length: Steps that the running episode has taken, shape (nworld,), int32.
        qpos: Joint positions, shape (nworld, nq); columns 0 to 2 are the base's x, y [m] and yaw [rad].
        velocity: Forward [m/s] and turning [rad/s] speed of the base, shape (nworld, 2).
        speed_scale: Factor on its speed limits, shape (nworld,).
        hull_low: Boxes around the robot, see `hulls.measure_hulls`.
        hull_high: Their highest corners.
        drive: How the base follows commands.
        things: What is near, as the guard has gathered it.
        field: Ways to the goal through what was seen.
        patience: Steps after which a base that is kept from its commands in one place is stuck; others are
            after twice as many.
        recovery: Who is stuck; changed.
        action: Actions in [-1, 1], shape (nworld, 10); the first two are changed.
        guarded: Whether they were, shape (nworld,), bool; changed.
    """
    wp.launch(
        _recover,
        dim=qpos.shape[0],
        inputs=[
            episode_length,
            qpos,
            velocity,
            speed_scale,
            hull_low,
            hull_high,
            drive,
            things,
            field,
            patience,
            recovery,
            action,
            guarded,
        ],
        device=qpos.device,
    )
