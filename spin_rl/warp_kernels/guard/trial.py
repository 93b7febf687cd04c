# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportInvalidTypeForm=false
# pyright: reportAttributeAccessIssue=false, reportReturnType=false
# pyright: reportCallIssue=false, reportIndexIssue=false, reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Commands tried: the base drives them in thought, among what is remembered.

What a hull overlaps at the start already, because boxes say more than there is, it may leave but not go
deeper into. Things go on as they were seen to move.
"""

import warp as wp

from spin_rl.warp_kernels.guard.hulls import NUM_HULLS, Hulls, half_of, hulls_of, middle_of
from spin_rl.warp_kernels.memory import Memory, Thing, is_remembered, recall
from spin_rl.warp_kernels.slots import Slots

REACH_M = wp.constant(1.6)
"""Nothing farther from the base's origin is hit within the time that is looked ahead [m]."""

_STEP_S = wp.constant(0.1)
"""Time between poses that are tried, a control step [s]."""
_BRAKE_STEPS = wp.constant(4)
"""After these a base that brakes stands, nearly."""
_ROUNDING_M = wp.constant(1.0e-3)
"""More than rounding errors of distances."""
_LEVEL_M = wp.constant(0.01)
"""What passes above or below a box at this distance touches it [m]."""
_DEEPER_M = wp.constant(0.002)
"""A hull that overlaps a thing goes deeper into it when it does by so much [m]."""

wp.set_module_options({"enable_backward": False})


@wp.struct
class Things:
    """What is near, in the base frame: arrays (nworld, k) as in `Thing`; ``count`` are set.

    ``gap`` is how far each hull is from it now, negative where they overlap [m]. ``reach`` is the distance
    of its middle to the base's origin from which it hits nothing [m], 0 if it is at the height of no hull.
    """

    place: wp.array2d[wp.vec3]
    drift: wp.array2d[wp.vec2]
    half: wp.array2d[wp.vec2]
    height: wp.array2d[wp.vec2]
    gap: wp.array2d[wp.vec4]
    reach: wp.array2d[float]
    count: wp.array[int]


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
class Trial:
    """All that commands are tried with."""

    hulls: Hulls
    things: Things
    drive: Drive
    margin: float


@wp.func
def trial_of(
    world: int,
    hull_low: wp.array2d[wp.vec3],
    hull_high: wp.array2d[wp.vec3],
    drive: Drive,
    things: Things,
    margin: float,
) -> Trial:
    """Gather what a world's commands are tried with."""
    trial = Trial()
    trial.hulls = hulls_of(world, hull_low, hull_high)
    trial.things = things
    trial.drive = drive
    trial.margin = margin
    return trial


@wp.struct
class Motion:
    """A base on its way: pose in the frame where it began, speeds, and whether it has hit anything."""

    pose: wp.vec3
    speed: wp.vec2
    hit: bool


@wp.func
def _circle(half: wp.vec2, thing: Thing, margin: float) -> float:
    """Distance of their middles from which a rectangle and a thing do not `overlap`, whatever their yaw."""
    return wp.length(half) + wp.length(thing.half) + 1.5 * wp.max(margin, 0.0) + _ROUNDING_M


@wp.func
def overlap(centre: wp.vec2, yaw: float, half: wp.vec2, thing: Thing, margin: float) -> bool:
    """Whether a rectangle on the floor comes nearer to a thing than a margin, by separating axes."""
    dx = thing.place[0] - centre[0]
    dy = thing.place[1] - centre[1]
    if wp.length(wp.vec2(dx, dy)) > _circle(half, thing, margin):
        return False
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
def thing_of(world: int, k: int, things: Things) -> Thing:
    """Read what is known of a thing, where it is now."""
    thing = Thing()
    thing.place = things.place[world, k]
    thing.drift = things.drift[world, k]
    thing.half = things.half[world, k]
    thing.height = things.height[world, k]
    return thing


@wp.func
def is_level(world: int, k: int, things: Things, hulls: Hulls, hull: int) -> bool:
    """Whether a thing is at the height of a hull."""
    height = things.height[world, k]
    return height[0] < hulls.high[hull, 2] + _LEVEL_M and height[1] > hulls.low[hull, 2] - _LEVEL_M


@wp.func
def gap_between(centre: wp.vec2, half: wp.vec2, thing: Thing) -> float:
    """Distance of an aligned rectangle from a thing along the axis that separates them most [m]."""
    cos_yaw = wp.cos(thing.place[2])
    sin_yaw = wp.sin(thing.place[2])
    dx = thing.place[0] - centre[0]
    dy = thing.place[1] - centre[1]
    wide = wp.abs(cos_yaw)
    cross = wp.abs(sin_yaw)
    gap = wp.abs(dx) - half[0] - wide * thing.half[0] - cross * thing.half[1]
    gap = wp.max(gap, wp.abs(dy) - half[1] - cross * thing.half[0] - wide * thing.half[1])
    along = wp.abs(cos_yaw * dx + sin_yaw * dy)
    aside = wp.abs(cos_yaw * dy - sin_yaw * dx)
    gap = wp.max(gap, along - thing.half[0] - wide * half[0] - cross * half[1])
    return wp.max(gap, aside - thing.half[1] - cross * half[0] - wide * half[1])


@wp.func
def _hits(world: int, pose: wp.vec3, steps: float, trial: Trial) -> bool:
    """Whether the robot at a pose in the present base frame, steps from now, touches what it does not now."""
    cos_yaw = wp.cos(pose[2])
    sin_yaw = wp.sin(pose[2])
    for k in range(trial.things.count[world]):
        gap = trial.things.gap[world, k]
        thing = thing_of(world, k, trial.things)
        thing.place += steps * wp.vec3(thing.drift[0], thing.drift[1], 0.0)
        away = wp.vec2(thing.place[0] - pose[0], thing.place[1] - pose[1])
        if wp.length(away) <= trial.things.reach[world, k]:
            for hull in range(NUM_HULLS):
                if is_level(world, k, trial.things, trial.hulls, hull):
                    middle = middle_of(trial.hulls, hull)
                    centre = wp.vec2(
                        pose[0] + cos_yaw * middle[0] - sin_yaw * middle[1],
                        pose[1] + sin_yaw * middle[0] + cos_yaw * middle[1],
                    )
                    margin = wp.min(trial.margin, wp.max(gap[hull] - _DEEPER_M, 0.0))
                    if gap[hull] < 0.0:
                        margin = gap[hull] - _DEEPER_M
                    if overlap(centre, pose[2], half_of(trial.hulls, hull), thing, margin):
                        return True
    return False


@wp.func
def _follow(now: float, command: float, most: float, blend: float) -> float:
    """A speed one step later: a first-order lag with a limit."""
    return now + wp.clamp((command - now) * blend, -most, most)


@wp.func
def drive_on(world: int, motion: Motion, command: wp.vec2, first: int, steps: int, trial: Trial) -> Motion:
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
def is_free(world: int, velocity: wp.vec2, command: wp.vec2, steps: int, trial: Trial) -> bool:
    """Whether driving a command [m/s, rad/s] for some steps, then braking, hits nothing."""
    start = Motion()
    start.speed = velocity
    driven = drive_on(world, start, command, 0, steps, trial)
    return not drive_on(world, driven, wp.vec2(0.0, 0.0), steps, _BRAKE_STEPS, trial).hit


@wp.func
def gather(
    slots: Slots,
    nearby: wp.array2d[int],
    memory: Memory,
    world: int,
    base: wp.vec3,
    hulls: Hulls,
    margin: float,
    things: Things,
):
    """List what is remembered within reach, to be tried with a margin of no more than this [m]."""
    count = int(0)
    for token in range(nearby.shape[1]):
        slot = nearby[world, token]
        if slot < 0:
            break
        if is_remembered(memory, world, slot):
            thing = recall(memory, slots, world, slot, base)
            distance = wp.length(wp.vec2(thing.place[0], thing.place[1])) - wp.length(thing.half)
            if distance < REACH_M or wp.length(thing.drift) > 0.0:
                things.place[world, count] = thing.place
                things.drift[world, count] = thing.drift
                things.half[world, count] = thing.half
                things.height[world, count] = thing.height
                gap = wp.vec4()
                reach = float(0.0)
                for hull in range(NUM_HULLS):
                    middle = middle_of(hulls, hull)
                    half = half_of(hulls, hull)
                    gap[hull] = gap_between(middle, half, thing)
                    if is_level(world, count, things, hulls, hull):
                        reach = wp.max(reach, wp.length(middle) + _circle(half, thing, margin))
                things.gap[world, count] = gap
                things.reach[world, count] = reach
                count += 1
    things.count[world] = count
