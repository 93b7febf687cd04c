# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportInvalidTypeForm=false
# pyright: reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportIndexIssue=false, reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""A guard between policy and base: where a command would end in what was seen, the nearest that does not.

A command is tried by driving it for a while and braking then. The robot is four upright boxes that turn with
the base: the base itself, mast and head, arm, hand. What such a box overlaps at the start already does not
count for it: there the box says more than the robot is. Things go on as they were seen to move.

Source: the dynamic window approach (Fox, Burgard and Thrun 1997), as a filter of commands.
"""

import warp as wp

from spin_rl.warp_kernels.distance_field.field import Field, field_at
from spin_rl.warp_kernels.distance_field.trace import downhill
from spin_rl.warp_kernels.memory import Memory, Thing, is_remembered, recall
from spin_rl.warp_kernels.slots import Slots

NUM_HULLS = wp.constant(4)
"""Base; mast and head; arm; wrist and gripper."""

REACH_M = wp.constant(1.6)
"""Nothing farther from the base's origin is hit within the time that is looked ahead [m]."""

_STEP_S = wp.constant(0.1)
"""Time between poses that are tried, a control step [s]."""
_BRAKE_STEPS = wp.constant(4)
"""After these a base that brakes stands, nearly."""
_LEVEL_M = wp.constant(0.01)
"""What passes above or below a box at this distance touches it [m]."""

_SPEEDS = wp.constant(6)
"""Speeds that are tried: the commanded one, parts of it down to 0, and a slow one backwards."""
_BACK_M_S = wp.constant(0.2)
_TURNS = wp.constant(9)
"""Turning speeds that are tried, a quarter of the limit apart."""
_TURN_COST = wp.constant(0.7)
"""How unlike a command another turning speed makes it, the forward speed counting 1."""
_NONE = wp.constant(1.0e3)

STUCK_STEPS = wp.constant(30)
MOVED_M = wp.constant(0.15)
RESCUE_STEPS = wp.constant(40)
FIRST_STEPS = wp.constant(8)
SECOND_STEPS = wp.constant(10)
_SLOW_M_S = wp.constant(0.3)
_HEADING_M = wp.constant(0.3)

_Corners = wp.types.matrix(shape=(4, 3), dtype=wp.float32)

wp.set_module_options({"enable_backward": False})


@wp.struct
class Shapes:
    """The robot's collision geoms; arrays (nshape,). ``hull`` is the box that a geom is in.

    ``half_size`` are half extents of a box, or (0, 0, half length) of a capsule, which has a ``radius`` [m].
    """

    geom: wp.array[int]
    hull: wp.array[int]
    half_size: wp.array[wp.vec3]
    radius: wp.array[float]


@wp.struct
class Things:
    """What is near, in the base frame: arrays (nworld, k) as in `Thing`; ``count`` are set.

    ``hit`` has a bit for each hull that the thing overlaps already.
    """

    place: wp.array2d[wp.vec3]
    drift: wp.array2d[wp.vec2]
    half: wp.array2d[wp.vec2]
    height: wp.array2d[wp.vec2]
    hit: wp.array2d[int]
    count: wp.array[int]


@wp.struct
class Rescue:
    """What is done where the robot got stuck; arrays (nworld,)."""

    stuck: wp.array[int]
    left: wp.array[int]
    hold: wp.array[int]
    place: wp.array[wp.vec2]
    command: wp.array[wp.vec2]


@wp.struct
class Drive:
    """How the base follows commands: speed limits and accelerations [m, rad, s], and its lag [s]."""

    forward: float
    reverse: float
    turn: float
    acceleration: float
    turn_acceleration: float
    lag: float


@wp.struct
class Hulls:
    """Lowest and highest corners of the robot's boxes in the base frame [m]."""

    low: _Corners
    high: _Corners


@wp.struct
class Trial:
    """All that commands are tried with."""

    hulls: Hulls
    things: Things
    drive: Drive
    margin: float


@wp.func
def _middle(hulls: Hulls, hull: int) -> wp.vec2:
    return wp.vec2(
        0.5 * (hulls.low[hull, 0] + hulls.high[hull, 0]), 0.5 * (hulls.low[hull, 1] + hulls.high[hull, 1])
    )


@wp.func
def _half(hulls: Hulls, hull: int) -> wp.vec2:
    return wp.vec2(
        0.5 * (hulls.high[hull, 0] - hulls.low[hull, 0]), 0.5 * (hulls.high[hull, 1] - hulls.low[hull, 1])
    )


@wp.func
def _overlap(centre: wp.vec2, yaw: float, half: wp.vec2, thing: Thing, margin: float) -> bool:
    """Whether a rectangle on the floor comes nearer to a thing than a margin, by separating axes."""
    dx = thing.place[0] - centre[0]
    dy = thing.place[1] - centre[1]
    turn = thing.place[2] - yaw
    cos_turn = wp.abs(wp.cos(turn))
    sin_turn = wp.abs(wp.sin(turn))
    along = wp.abs(wp.cos(yaw) * dx + wp.sin(yaw) * dy)
    aside = wp.abs(wp.cos(yaw) * dy - wp.sin(yaw) * dx)
    if along > half[0] + cos_turn * thing.half[0] + sin_turn * thing.half[1] + margin:
        return False
    if aside > half[1] + sin_turn * thing.half[0] + cos_turn * thing.half[1] + margin:
        return False
    cos_thing = wp.cos(thing.place[2])
    sin_thing = wp.sin(thing.place[2])
    along = wp.abs(cos_thing * dx + sin_thing * dy)
    aside = wp.abs(cos_thing * dy - sin_thing * dx)
    if along > thing.half[0] + cos_turn * half[0] + sin_turn * half[1] + margin:
        return False
    return aside <= thing.half[1] + sin_turn * half[0] + cos_turn * half[1] + margin


@wp.func
def _hits(world: int, pose: wp.vec3, steps: float, trial: Trial) -> bool:
    """Whether the robot at a pose in the present base frame, steps from now, touches what it does not now."""
    cos_yaw = wp.cos(pose[2])
    sin_yaw = wp.sin(pose[2])
    for k in range(trial.things.count[world]):
        hit = trial.things.hit[world, k]
        height = trial.things.height[world, k]
        drift = trial.things.drift[world, k]
        thing = Thing()
        thing.place = trial.things.place[world, k] + steps * wp.vec3(drift[0], drift[1], 0.0)
        thing.half = trial.things.half[world, k]
        for hull in range(NUM_HULLS):
            is_level = height[0] < trial.hulls.high[hull, 2] + _LEVEL_M
            is_level = is_level and height[1] > trial.hulls.low[hull, 2] - _LEVEL_M
            if is_level and (hit & (1 << hull)) == 0:
                middle = _middle(trial.hulls, hull)
                centre = wp.vec2(
                    pose[0] + cos_yaw * middle[0] - sin_yaw * middle[1],
                    pose[1] + sin_yaw * middle[0] + cos_yaw * middle[1],
                )
                if _overlap(centre, pose[2], _half(trial.hulls, hull), thing, trial.margin):
                    return True
    return False


@wp.func
def _follow(now: float, command: float, most: float, blend: float) -> float:
    """A speed one step later: a first-order lag with a limit."""
    return now + wp.clamp((command - now) * blend, -most, most)


@wp.func
def _is_free(world: int, velocity: wp.vec2, command: wp.vec2, steps: int, trial: Trial) -> bool:
    """Whether driving a command [m/s, rad/s] for some steps, then braking, hits nothing."""
    drive = trial.drive
    pose = wp.vec3(0.0, 0.0, 0.0)
    v = velocity[0]
    w = velocity[1]
    blend = 1.0 - wp.exp(-_STEP_S / drive.lag)
    for step in range(steps + _BRAKE_STEPS):
        goal = command
        if step >= steps:
            goal = wp.vec2(0.0, 0.0)
        next_v = _follow(v, goal[0], drive.acceleration * _STEP_S, blend)
        next_w = _follow(w, goal[1], drive.turn_acceleration * _STEP_S, blend)
        turned = 0.5 * _STEP_S * (w + next_w)
        driven = 0.5 * _STEP_S * (v + next_v)
        yaw = pose[2] + 0.5 * turned
        pose = wp.vec3(pose[0] + driven * wp.cos(yaw), pose[1] + driven * wp.sin(yaw), pose[2] + turned)
        v = next_v
        w = next_w
        if _hits(world, pose, float(step + 1), trial):
            return False
    return True


@wp.kernel
def _measure_hulls(
    shapes: Shapes,
    geom_xpos: wp.array2d[wp.vec3],
    geom_xmat: wp.array2d[wp.mat33],
    qpos: wp.array2d[float],
    low_out: wp.array2d[wp.vec3],
    high_out: wp.array2d[wp.vec3],
):
    """The boxes around the robot's geoms, in the base frame."""
    world = wp.tid()
    cos_yaw = wp.cos(qpos[world, 2])
    sin_yaw = wp.sin(qpos[world, 2])
    for hull in range(NUM_HULLS):
        low_out[world, hull] = wp.vec3(10.0, 10.0, 10.0)
        high_out[world, hull] = wp.vec3(-10.0, -10.0, -10.0)
    for i in range(shapes.geom.shape[0]):
        geom = shapes.geom[i]
        offset = geom_xpos[world, geom] - wp.vec3(qpos[world, 0], qpos[world, 1], 0.0)
        centre = wp.vec3(
            cos_yaw * offset[0] + sin_yaw * offset[1], cos_yaw * offset[1] - sin_yaw * offset[0], offset[2]
        )
        half = shapes.half_size[i]
        frame = geom_xmat[world, geom]
        reach = wp.vec3(0.0, 0.0, 0.0)
        for axis in range(3):
            column = wp.vec3(frame[0, axis], frame[1, axis], frame[2, axis])
            in_base = wp.vec3(
                cos_yaw * column[0] + sin_yaw * column[1],
                cos_yaw * column[1] - sin_yaw * column[0],
                column[2],
            )
            reach += half[axis] * wp.vec3(wp.abs(in_base[0]), wp.abs(in_base[1]), wp.abs(in_base[2]))
        reach += wp.vec3(shapes.radius[i], shapes.radius[i], shapes.radius[i])
        hull = shapes.hull[i]
        low_out[world, hull] = wp.min(low_out[world, hull], centre - reach)
        high_out[world, hull] = wp.max(high_out[world, hull], centre + reach)


@wp.func
def _gather(
    slots: Slots,
    nearby: wp.array2d[int],
    memory: Memory,
    world: int,
    base: wp.vec3,
    hulls: Hulls,
    margin: float,
    things: Things,
):
    """List what is remembered within reach, with the hulls that it overlaps already."""
    count = int(0)
    for token in range(nearby.shape[1]):
        slot = nearby[world, token]
        if slot < 0:
            break
        if is_remembered(memory, world, slot):
            thing = recall(memory, slots, world, slot, base)
            distance = wp.length(wp.vec2(thing.place[0], thing.place[1])) - wp.length(thing.half)
            if distance < REACH_M:
                hit = int(0)
                for hull in range(NUM_HULLS):
                    if _overlap(_middle(hulls, hull), 0.0, _half(hulls, hull), thing, margin):
                        hit = hit | (1 << hull)
                things.place[world, count] = thing.place
                things.drift[world, count] = thing.drift
                things.half[world, count] = thing.half
                things.height[world, count] = thing.height
                things.hit[world, count] = hit
                count += 1
    things.count[world] = count


@wp.func
def _nearest_free(
    world: int, now: wp.vec2, command: wp.vec2, limit: wp.vec3, steps: int, trial: Trial
) -> wp.vec2:
    """The command most like a given one that hits nothing, looking ahead less if none does; else a stop."""
    best = wp.vec2(0.0, 0.0)
    least = float(_NONE)
    looked = steps
    while looked > 0 and least == _NONE:
        for i in range(_SPEEDS):
            v = command[0] * (1.0 - float(i) / float(_SPEEDS - 2))
            if i == _SPEEDS - 1:
                v = -wp.min(limit[1], _BACK_M_S)
            for j in range(_TURNS):
                turn = 0.25 * limit[2] * float(j - _TURNS // 2)
                tried = wp.vec2(v, wp.clamp(command[1] + turn, -limit[2], limit[2]))
                cost = wp.abs(v - command[0]) / limit[0]
                cost += _TURN_COST * wp.abs(tried[1] - command[1]) / limit[2]
                if cost < least and _is_free(world, now, tried, looked, trial):
                    least = cost
                    best = tried
        looked = looked - 2
    return best


@wp.struct
class Motion:
    """A base on its way: pose in the frame where it began, speeds, and whether it has hit anything."""

    pose: wp.vec3
    speed: wp.vec2
    hit: bool


@wp.func
def _drive_on(world: int, motion: Motion, command: wp.vec2, first: int, steps: int, trial: Trial) -> Motion:
    """Drive a command for some steps more; ``first`` were driven before."""
    now = motion
    blend = 1.0 - wp.exp(-_STEP_S / trial.drive.lag)
    step = int(0)
    while step < steps and not now.hit:
        v = _follow(now.speed[0], command[0], trial.drive.acceleration * _STEP_S, blend)
        w = _follow(now.speed[1], command[1], trial.drive.turn_acceleration * _STEP_S, blend)
        turned = 0.5 * _STEP_S * (now.speed[1] + w)
        driven = 0.5 * _STEP_S * (now.speed[0] + v)
        yaw = now.pose[2] + 0.5 * turned
        now.pose = wp.vec3(
            now.pose[0] + driven * wp.cos(yaw), now.pose[1] + driven * wp.sin(yaw), now.pose[2] + turned
        )
        now.speed = wp.vec2(v, w)
        step += 1
        now.hit = _hits(world, now.pose, float(first + step), trial)
    return now


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
def _way_out(world: int, now: wp.vec2, base: wp.vec3, limit: wp.vec3, trial: Trial, field: Field) -> wp.vec2:
    """The first of two commands, one after the other, that hit nothing and bring the base nearest to the goal."""
    best = wp.vec2(0.0, 0.0)
    least = float(1.0e9)
    slow = wp.min(limit[0], _SLOW_M_S)
    back = -wp.min(limit[1], _BACK_M_S)
    start = Motion()
    start.speed = now
    for i in range(3 * 5):
        v = wp.where(i // 5 == 0, slow, wp.where(i // 5 == 1, 0.0, back))
        command = wp.vec2(v, 0.5 * limit[2] * float(i % 5 - 2))
        middle = _drive_on(world, start, command, 0, FIRST_STEPS, trial)
        if not middle.hit:
            for j in range(2 * 5):
                then = wp.vec2(wp.where(j // 5 == 0, slow, 0.0), 0.5 * limit[2] * float(j % 5 - 2))
                end = _drive_on(world, middle, then, FIRST_STEPS, SECOND_STEPS, trial)
                if not end.hit:
                    cost = _left_to_go(world, end.pose, base, field)
                    if cost < least:
                        least = cost
                        best = command
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
    field: Field,
    rescue: Rescue,
    action: wp.array2d[float],
    guarded_out: wp.array[wp.bool],
):
    world = wp.tid()
    trial = Trial()
    for hull in range(NUM_HULLS):
        for axis in range(3):
            trial.hulls.low[hull, axis] = hull_low[world, hull][axis]
            trial.hulls.high[hull, axis] = hull_high[world, hull][axis]
    trial.drive = drive
    trial.things = things
    trial.margin = margin
    base = wp.vec3(qpos[world, 0], qpos[world, 1], qpos[world, 2])
    _gather(slots, nearby, memory, world, base, trial.hulls, margin, things)

    limit = speed_scale[world] * wp.vec3(drive.forward, drive.reverse, drive.turn)
    ahead = wp.clamp(action[world, 0], -1.0, 1.0)
    command = wp.vec2(
        ahead * wp.where(ahead > 0.0, limit[0], limit[1]), wp.clamp(action[world, 1], -1.0, 1.0) * limit[2]
    )
    now = wp.vec2(velocity[world, 0], velocity[world, 1])
    guarded_out[world] = not _is_free(world, now, command, steps, trial)
    here = wp.vec2(base[0], base[1])
    if wp.length(here - rescue.place[world]) > MOVED_M:
        rescue.place[world] = here
        rescue.stuck[world] = 0
    else:
        rescue.stuck[world] = rescue.stuck[world] + wp.where(guarded_out[world], 2, 1)
    if rescue.stuck[world] >= STUCK_STEPS and rescue.left[world] == 0:
        rescue.stuck[world] = 0
        rescue.left[world] = RESCUE_STEPS
        rescue.hold[world] = 0
    if rescue.left[world] > 0:
        rescue.left[world] = rescue.left[world] - 1
        guarded_out[world] = True
        if rescue.hold[world] == 0 or not _is_free(world, now, rescue.command[world], 2, trial):
            rescue.command[world] = _way_out(world, now, base, limit, trial, field)
            rescue.hold[world] = FIRST_STEPS
        rescue.hold[world] = rescue.hold[world] - 1
        best = rescue.command[world]
        if not _is_free(world, now, best, 1, trial):
            best = wp.vec2(0.0, 0.0)
        action[world, 0] = best[0] / wp.where(best[0] > 0.0, limit[0], limit[1])
        action[world, 1] = best[1] / limit[2]
    elif guarded_out[world]:
        best = _nearest_free(world, now, command, limit, steps, trial)
        action[world, 0] = best[0] / wp.where(best[0] > 0.0, limit[0], limit[1])
        action[world, 1] = best[1] / limit[2]


def measure_hulls(
    shapes: Shapes,
    geom_xpos: wp.array,
    geom_xmat: wp.array,
    qpos: wp.array,
    low_out: wp.array,
    high_out: wp.array,
) -> None:
    """Measure the boxes around the robot's geoms; graph-safe.

    Args:
        shapes: The robot's collision geoms.
        geom_xpos: Positions of all geoms in the world [m], shape (nworld, ngeom), vec3.
        geom_xmat: Their frames, shape (nworld, ngeom), mat33.
        qpos: Joint positions, shape (nworld, nq).
        low_out: Output, lowest corners in the base frame [m], shape (nworld, NUM_HULLS), vec3.
        high_out: Output, highest corners, likewise.
    """
    wp.launch(
        _measure_hulls,
        dim=qpos.shape[0],
        inputs=[shapes, geom_xpos, geom_xmat, qpos],
        outputs=[low_out, high_out],
        device=qpos.device,
    )


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
    field: Field,
    rescue: Rescue,
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
            field,
            rescue,
            action,
        ],
        outputs=[guarded_out],
        device=qpos.device,
    )
