# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportInvalidTypeForm=false
# pyright: reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportIndexIssue=false, reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Getting out of the way of what moves, which does not stop for a robot that stands.

What was seen to move is expected to go on, for longer than the filter looks ahead: a slow robot needs seconds
to leave a way. Where its command, followed by a stop, would be met, the robot takes the most similar one that
is not.
"""

import warp as wp

from spin_rl.warp_kernels.guard.filter import BACK_M_S, limits_of, put_command
from spin_rl.warp_kernels.guard.trial import Drive, Motion, Things, Trial, drive_on, trial_of

_HOLDS = wp.constant(3)
_HOLD_STEPS = wp.constant(8)
"""Commands are tried for so many steps, for twice and for three times as many, before a stop."""
_SPEEDS = wp.constant(4)
"""Speeds that are tried: the highest, half of it, none, and a slow one backwards."""
_TURNS = wp.constant(9)
"""Turning speeds that are tried, a quarter of the limit apart."""
_TURN_COST = wp.constant(0.7)
"""How unlike a command another turning speed makes it, the forward speed counting 1."""
_LATER = wp.constant(10.0)
"""What being met a step later is worth."""

wp.set_module_options({"enable_backward": False, "max_unroll": 1})  # unrolled, CUDA takes minutes to compile


@wp.func
def _something_moves(world: int, things: Things) -> bool:
    for k in range(things.count[world]):
        if wp.length(things.drift[world, k]) > 0.0:
            return True
    return False


@wp.func
def _steps_free(world: int, now: wp.vec2, command: wp.vec2, hold: int, steps: int, trial: Trial) -> int:
    """Steps until something is hit if a command is driven for some steps, then 0; all if nothing is."""
    motion = Motion()
    motion.speed = now
    free = int(0)
    while free < steps and not motion.hit:
        to = wp.where(free < hold, command, wp.vec2(0.0, 0.0))
        motion = drive_on(world, motion, to, free, 1, trial)
        free += 1
    return wp.where(motion.hit, free - 1, steps)


@wp.func
def _longest_free(
    world: int, now: wp.vec2, asked: wp.vec2, limit: wp.vec3, steps: int, trial: Trial
) -> wp.vec2:
    """The command that hits nothing for longest, of those alike the one most like a given one."""
    best = asked
    least = float(steps) * _LATER + 10.0
    for n in range(_HOLDS * _SPEEDS * _TURNS + _HOLDS):
        tried = asked
        if n >= _HOLDS:
            i = (n - _HOLDS) // (_HOLDS * _TURNS)
            v = limit[0] * (1.0 - 0.5 * float(i))
            if i == _SPEEDS - 1:
                v = -wp.min(limit[1], BACK_M_S)
            j = (n - _HOLDS) // _HOLDS % _TURNS
            tried = wp.vec2(v, 0.25 * limit[2] * float(j - _TURNS // 2))
        cost = wp.abs(tried[0] - asked[0]) / limit[0] + _TURN_COST * wp.abs(tried[1] - asked[1]) / limit[2]
        if cost < least:
            free = _steps_free(world, now, tried, _HOLD_STEPS * (1 + n % _HOLDS), steps, trial)
            cost += _LATER * float(steps - free)
            if cost < least:
                least = cost
                best = tried
    return best


@wp.kernel
def _evade(
    qpos: wp.array2d[float],
    velocity: wp.array2d[float],
    speed_scale: wp.array[float],
    hull_low: wp.array2d[wp.vec3],
    hull_high: wp.array2d[wp.vec3],
    drive: Drive,
    things: Things,
    steps: int,
    margin: float,
    action: wp.array2d[float],
    guarded: wp.array[wp.bool],
):
    world = wp.tid()
    if not _something_moves(world, things):
        return
    trial = trial_of(world, hull_low, hull_high, drive, things, margin)
    limit = limits_of(drive, speed_scale[world])
    now = wp.vec2(velocity[world, 0], velocity[world, 1])
    ahead = wp.clamp(action[world, 0], -1.0, 1.0)
    asked = wp.vec2(
        ahead * wp.where(ahead > 0.0, limit[0], limit[1]), wp.clamp(action[world, 1], -1.0, 1.0) * limit[2]
    )
    if _steps_free(world, now, asked, _HOLD_STEPS, steps, trial) == steps:
        return
    guarded[world] = True
    put_command(world, _longest_free(world, now, asked, limit, steps, trial), limit, action)


def evade(
    *,
    qpos: wp.array,
    velocity: wp.array,
    speed_scale: wp.array,
    hull_low: wp.array,
    hull_high: wp.array,
    drive: Drive,
    things: Things,
    steps: int,
    margin: float,
    action: wp.array,
    guarded: wp.array,
) -> None:
    """Replace base actions after which something that moves would meet the robot; graph-safe, comes last.

    Args:
        qpos: Joint positions, shape (nworld, nq).
        velocity: Forward [m/s] and turning [rad/s] speed of the base, shape (nworld, 2).
        speed_scale: Factor on its speed limits, shape (nworld,).
        hull_low: Boxes around the robot, see `hulls.measure_hulls`.
        hull_high: Their highest corners.
        drive: How the base follows commands.
        things: What is near, as the guard has gathered it.
        steps: Control steps that what moves is foreseen.
        margin: Distance that counts as a hit [m].
        action: Actions in [-1, 1], shape (nworld, 10); the first two are changed.
        guarded: Whether they were, shape (nworld,), bool; changed.
    """
    wp.launch(
        _evade,
        dim=qpos.shape[0],
        inputs=[
            qpos,
            velocity,
            speed_scale,
            hull_low,
            hull_high,
            drive,
            things,
            steps,
            margin,
            action,
            guarded,
        ],
        device=qpos.device,
    )
