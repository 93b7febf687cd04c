# pyright: reportGeneralTypeIssues=false, reportCallIssue=false, reportOperatorIssue=false
# pyright: reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Obstacles along a stretch of corridor, as Warp functions: always passable, by construction.

A stretch has a coordinate s along and t across (left positive). Obstacles are drawn in the order in which the
robot meets them, each reaching from one side wall so far into the corridor that `passage` remains at the
other side. Where two of them overlap across, so that the robot must swing from one side to the other, the
second one starts late enough. The room that is left over along the stretch is spread at random.
"""

import warp as wp

from spin_rl.scenes.corridors.struct import ParamsStruct
from spin_rl.warp_kernels.slots import Slots, put_slot

MAX_OBSTACLES = wp.constant(8)
"""Most obstacles of one stretch."""

_TRIES = wp.constant(6)
"""Draws per stretch; each one draws smaller obstacles, until they fit."""

_vec8 = wp.types.vector(length=8, dtype=float)
_vec8i = wp.types.vector(length=8, dtype=wp.int32)

_LOW = wp.constant(0)
_TALL = wp.constant(1)
_ARM = wp.constant(2)
_HEAD = wp.constant(3)

wp.set_module_options({"enable_backward": False})


@wp.struct
class Stretch:
    """A straight piece of corridor that takes obstacles.

    ``origin + s * along`` is its centre line, for begin <= s <= end. ``first_side`` pins the first obstacle
    to the beginning and to a side (1 left, -1 right); 0 leaves it free.
    """

    origin: wp.vec2
    along: wp.vec2
    begin: float
    end: float
    width: float
    first_side: float


@wp.struct
class Used:
    """Slots taken so far in one world, counted within their kind, and obstacles placed."""

    boxes: int
    cylinders: int
    obstacles: int


@wp.func
def draw_kind(u: float, p: ParamsStruct) -> int:
    """Kind of obstacle for a uniform number."""
    if u < p.head_share:
        return _HEAD
    if u < p.head_share + p.arm_share:
        return _ARM
    if u < p.head_share + p.arm_share + p.tall_share:
        return _TALL
    return _LOW


@wp.func
def draw_heights(kind: int, u: float, v: float, p: ParamsStruct) -> wp.vec2:
    """Bottom and top of an obstacle for two uniform numbers."""
    if kind == _LOW:
        return wp.vec2(0.0, wp.lerp(p.low_top[0], p.low_top[1], u))
    if kind == _TALL:
        return wp.vec2(0.0, wp.lerp(p.tall_top[0], p.tall_top[1], u))
    if kind == _ARM:
        bottom = wp.lerp(p.arm_bottom[0], p.arm_bottom[1], u)
        return wp.vec2(bottom, bottom + wp.lerp(p.arm_thickness[0], p.arm_thickness[1], v))
    bottom = wp.lerp(p.head_bottom[0], p.head_bottom[1], u)
    return wp.vec2(bottom, bottom + wp.lerp(p.head_thickness[0], p.head_thickness[1], v))


@wp.func
def place_obstacles(
    world: int,
    count: int,
    stretch: Stretch,
    p: ParamsStruct,
    seed: int,
    used: Used,
    first_box: int,
    first_cylinder: int,
    slots: Slots,
) -> Used:
    """Write up to ``count`` obstacles into a stretch; fewer only if not even the smallest ones fit.

    Args:
        world: World to write.
        count: Obstacles wanted, at most `MAX_OBSTACLES`.
        stretch: Where.
        p: Generator parameters.
        seed: Seed of this stretch.
        used: Slots taken so far.
        first_box: Slot of the first box.
        first_cylinder: Slot of the first cylinder.
        slots: Output.

    Returns:
        Slots taken now.
    """
    taken = used
    if count <= 0:
        return taken
    wanted = wp.min(count, MAX_OBSTACLES)
    room = stretch.end - stretch.begin
    # The widest an obstacle may reach across, and what the robot needs to drive past it without turning.
    reach = wp.min(p.protrusion[1], stretch.width - p.passage)
    state = wp.rand_init(seed, 1)

    kind = _vec8i()
    round_ = _vec8i()
    side = _vec8()
    extent = _vec8()  # how far it reaches from its wall
    half_across = _vec8()
    half_along = _vec8()
    half_x = _vec8()
    half_y = _vec8()
    yaw = _vec8()
    start = _vec8()
    fits = bool(False)

    for attempt in range(_TRIES):
        if not fits:
            shrink = 1.0 - float(attempt) / float(_TRIES - 1)
            reach_now = p.protrusion[0] + shrink * (reach - p.protrusion[0])
            length_now = p.half_length[0] + shrink * (p.half_length[1] - p.half_length[0])
            if attempt == _TRIES - 1:
                while wanted > 1 and float(wanted) * (2.0 * length_now + 0.1 + p.same_side_gap) > room:
                    wanted -= 1
            cylinders = taken.cylinders
            boxes = taken.boxes
            for k in range(wanted):
                kind[k] = draw_kind(wp.randf(state), p)
                side[k] = wp.where(wp.randf(state) < 0.5, -1.0, 1.0)
                if k == 0 and stretch.first_side != 0.0:
                    side[k] = stretch.first_side
                on_floor = kind[k] == _LOW or kind[k] == _TALL
                standing = wp.randf(state) < p.standing_share
                wants_cylinder = wp.randf(state) < p.cylinder_share and on_floor
                u = wp.randf(state)
                v = wp.randf(state)
                turn = p.box_yaw * (2.0 * wp.randf(state) - 1.0)
                along = wp.lerp(p.half_length[0], length_now, wp.randf(state))
                no_box = first_box + boxes >= first_cylinder
                if (wants_cylinder or no_box) and first_cylinder + cylinders < slots.pos.shape[1]:
                    radius = wp.min(wp.lerp(p.radius[0], p.radius[1], u), 0.5 * reach_now)
                    cylinders += 1
                    round_[k] = 1
                    yaw[k] = 0.0
                    half_x[k] = radius
                    half_y[k] = radius
                    half_across[k] = radius
                    half_along[k] = radius
                    extent[k] = 2.0 * radius + v * (reach_now - 2.0 * radius)
                else:
                    boxes += 1
                    round_[k] = 0
                    across = 0.5 * wp.lerp(p.protrusion[0], reach_now, u)
                    extent[k] = 2.0 * across
                    if standing:
                        across = 0.5 * wp.min(wp.lerp(p.standing_width[0], p.standing_width[1], u), reach_now)
                        extent[k] = 2.0 * across + v * (reach_now - 2.0 * across)
                    # A long thin box turns less, so that its bounding rectangle across is the one drawn.
                    turn = wp.clamp(turn, -0.5 * across / along, 0.5 * across / along)
                    c = wp.cos(turn)
                    s = wp.abs(wp.sin(turn))
                    half_x[k] = along
                    half_y[k] = (across - along * s) / c
                    half_across[k] = across
                    half_along[k] = along * c + half_y[k] * s
                    yaw[k] = turn

            # Earliest starts along the stretch.
            for k in range(wanted):
                start[k] = 0.0
                for j in range(k):
                    gap = p.same_side_gap
                    if side[j] != side[k]:
                        swing = extent[j] + extent[k] - (stretch.width - p.passage)
                        if swing > 0.0:
                            gap = p.slalom_gap + p.slalom_gain * swing
                    start[k] = wp.max(start[k], start[j] + 2.0 * half_along[j] + gap)
            fits = start[wanted - 1] + 2.0 * half_along[wanted - 1] <= room
            fits = fits and first_box + boxes <= first_cylinder

    if not fits:
        return taken

    # Spread the room that is left: one random share before each obstacle, one behind the last.
    spare = room - start[wanted - 1] - 2.0 * half_along[wanted - 1]
    share = _vec8()
    total = -wp.log(1.0 - wp.randf(state))
    for k in range(wanted):
        share[k] = -wp.log(1.0 - wp.randf(state))
        if k == 0 and stretch.first_side != 0.0:
            share[k] = 0.0
        total += share[k]
    shift = float(0.0)
    left = wp.vec2(-stretch.along[1], stretch.along[0])
    heading = wp.atan2(stretch.along[1], stretch.along[0])
    for k in range(wanted):
        shift += spare * share[k] / total
        s_centre = stretch.begin + start[k] + shift + half_along[k]
        t_centre = side[k] * (0.5 * stretch.width - extent[k] + half_across[k])
        centre = stretch.origin + s_centre * stretch.along + t_centre * left
        heights = draw_heights(kind[k], wp.randf(state), wp.randf(state), p)
        slot = first_box + taken.boxes
        if round_[k] == 1:
            slot = first_cylinder + taken.cylinders
            taken.cylinders += 1
        else:
            taken.boxes += 1
        put_slot(
            world,
            slot,
            wp.vec3(centre[0], centre[1], 0.5 * (heights[0] + heights[1])),
            heading + yaw[k],
            wp.vec3(half_x[k], half_y[k], 0.5 * (heights[1] - heights[0])),
            slots,
        )
        taken.obstacles += 1
    return taken
