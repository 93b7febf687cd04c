# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportInvalidTypeForm=false
# pyright: reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportIndexIssue=false, reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""The filter of commands: where one would end in what was seen, the nearest that does not.

Source: the dynamic window approach (Fox, Burgard and Thrun 1997), as a filter of commands.
"""

import warp as wp

from spin_rl.warp_kernels.guard.trial import Drive, Things, Trial, gather, is_free, trial_of
from spin_rl.warp_kernels.memory import Memory
from spin_rl.warp_kernels.slots import Slots

BACK_M_S = wp.constant(0.2)
"""Speed that is tried backwards [m/s]."""

_SPEEDS = wp.constant(6)
"""Speeds that are tried: the commanded one, parts of it down to 0, and a slow one backwards."""
_TURNS = wp.constant(9)
"""Turning speeds that are tried, a quarter of the limit apart."""
_TURN_COST = wp.constant(0.7)
"""How unlike a command another turning speed makes it, the forward speed counting 1."""
_NONE = wp.constant(1.0e3)

wp.set_module_options({"enable_backward": False, "max_unroll": 1})  # unrolled, CUDA takes minutes to compile


@wp.func
def limits_of(drive: Drive, scale: float) -> wp.vec3:
    """Speed limits of a world: forward, reverse [m/s] and turning [rad/s]."""
    return scale * wp.vec3(drive.forward, drive.reverse, drive.turn)


@wp.func
def put_command(world: int, to: wp.vec2, limit: wp.vec3, action: wp.array2d[float]) -> None:
    """Write a command [m/s, rad/s] as the base's actions."""
    action[world, 0] = to[0] / wp.where(to[0] > 0.0, limit[0], limit[1])
    action[world, 1] = to[1] / limit[2]


@wp.func
def _nearest_free(
    world: int, now: wp.vec2, asked: wp.vec2, limit: wp.vec3, steps: int, trial: Trial
) -> wp.vec2:
    """The command most like a given one that hits nothing, looking ahead less if none does; else a stop."""
    best = wp.vec2(0.0, 0.0)
    least = float(_NONE)
    looked = steps
    while looked > 0 and least == _NONE:
        for i in range(_SPEEDS):
            v = asked[0] * (1.0 - float(i) / float(_SPEEDS - 2))
            if i == _SPEEDS - 1:
                v = -wp.min(limit[1], BACK_M_S)
            for j in range(_TURNS):
                turn = 0.25 * limit[2] * float(j - _TURNS // 2)
                tried = wp.vec2(v, wp.clamp(asked[1] + turn, -limit[2], limit[2]))
                cost = wp.abs(v - asked[0]) / limit[0]
                cost += _TURN_COST * wp.abs(tried[1] - asked[1]) / limit[2]
                if cost < least and is_free(world, now, tried, looked, trial):
                    least = cost
                    best = tried
        looked = looked - 2
    return best


@wp.kernel
def _guard(
    slots: Slots,
    nearby: wp.array2d[int],
    qpos: wp.array2d[float],
    velocity: wp.array2d[float],
    speed_scale: wp.array[float],
    memory: Memory,
    hull_low: wp.array2d[wp.vec3],
    hull_high: wp.array2d[wp.vec3],
    drive: Drive,
    steps: int,
    margin: float,
    things: Things,
    action: wp.array2d[float],
    guarded_out: wp.array[wp.bool],
):
    world = wp.tid()
    trial = trial_of(world, hull_low, hull_high, drive, things, margin)
    base = wp.vec3(qpos[world, 0], qpos[world, 1], qpos[world, 2])
    gather(slots, nearby, memory, world, base, trial.hulls, margin, things)

    limit = limits_of(drive, speed_scale[world])
    ahead = wp.clamp(action[world, 0], -1.0, 1.0)
    asked = wp.vec2(
        ahead * wp.where(ahead > 0.0, limit[0], limit[1]), wp.clamp(action[world, 1], -1.0, 1.0) * limit[2]
    )
    now = wp.vec2(velocity[world, 0], velocity[world, 1])
    guarded_out[world] = not is_free(world, now, asked, steps, trial)
    if guarded_out[world]:
        put_command(world, _nearest_free(world, now, asked, limit, steps, trial), limit, action)


def guard(
    slots: Slots,
    nearby: wp.array,
    memory: Memory,
    *,
    qpos: wp.array,
    velocity: wp.array,
    speed_scale: wp.array,
    hull_low: wp.array,
    hull_high: wp.array,
    drive: Drive,
    steps: int,
    margin: float,
    things: Things,
    action: wp.array,
    guarded_out: wp.array,
) -> None:
    """Replace base actions that would drive into what is remembered; graph-safe, before a control step.

    Args:
        slots: Walls and obstacles, for their heights.
        nearby: Slots to look at, shape (nworld, k), int32, negative ones behind the last.
        memory: What was seen of them.
        qpos: Joint positions, shape (nworld, nq); columns 0 to 2 are the base's x, y [m] and yaw [rad].
        velocity: Forward [m/s] and turning [rad/s] speed of the base, shape (nworld, 2).
        speed_scale: Factor on its speed limits, shape (nworld,).
        hull_low: Boxes around the robot, see `measure_hulls`.
        hull_high: Their highest corners.
        drive: How the base follows commands.
        steps: Control steps that a command is driven before it brakes.
        margin: Distance that counts as a hit [m].
        things: Scratch memory for k things a world.
        action: Actions in [-1, 1], shape (nworld, 10); the first two are changed.
        guarded_out: Output, whether they were, shape (nworld,), bool.
    """
    wp.launch(
        _guard,
        dim=qpos.shape[0],
        inputs=[
            slots,
            nearby,
            qpos,
            velocity,
            speed_scale,
            memory,
            hull_low,
            hull_high,
            drive,
            steps,
            margin,
            things,
            action,
        ],
        outputs=[guarded_out],
        device=qpos.device,
    )
