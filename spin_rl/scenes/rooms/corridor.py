# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportCallIssue=false
# pyright: reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Cluttered corridors with up to two corners and with dead ends, as a Warp function."""

import warp as wp

from spin_rl.scenes.corridors.clutter import Stretch, Used, place_obstacles
from spin_rl.scenes.corridors.struct import ParamsStruct
from spin_rl.scenes.rooms.geometry import Rectangles, Site, middle_of, shifted, with_rectangle
from spin_rl.scenes.rooms.struct import FamilyStruct
from spin_rl.scenes.rooms.walls import put_walls
from spin_rl.warp_kernels.slots import Slots

_MAX_LEGS = wp.constant(3)

_NARROW = wp.constant(0.45)
"""Half the width of dead ends beside a straight corridor [m]."""

wp.set_module_options({"enable_backward": False})


@wp.struct
class Strips:
    """Straight pieces of corridor, each along a centre line from its beginning in a direction.

    ``lines`` are (x, y, direction x, direction y), ``sizes`` (length, half width, length that obstacles may
    take, 0).
    """

    lines: Rectangles
    sizes: Rectangles
    count: int


@wp.func
def _with_strip(strips: Strips, begin: wp.vec2, along: wp.vec2, size: wp.vec3) -> Strips:
    """The strips and one more of (length, half width, length that obstacles may take)."""
    grown = strips
    lines = grown.lines
    sizes = grown.sizes
    lines[grown.count] = wp.vec4(begin[0], begin[1], along[0], along[1])
    sizes[grown.count] = wp.vec4(size[0], size[1], size[2], 0.0)
    grown.lines = lines
    grown.sizes = sizes
    grown.count = grown.count + 1
    return grown


@wp.func
def _rotated(along: wp.vec2, side: float) -> wp.vec2:
    """A direction turned by 90 degrees to a side (1 left, -1 right)."""
    return wp.vec2(-side * along[1], side * along[0])


@wp.func
def _draw_strips(width: float, p: ParamsStruct, q: FamilyStruct, seed: int) -> Strips:
    """Legs with 0, 1 or 2 corners, and dead ends; each leg owns the corner at its end."""
    state = wp.rand_init(seed, 1)
    few = q.corridor_corners[0]
    most = q.corridor_corners[1]
    corners = wp.min(few + int(float(most - few + 1) * wp.randf(state)), most)
    side = wp.where(wp.randf(state) < 0.5, -1.0, 1.0)
    is_u = wp.randf(state) < 0.5
    h = 0.5 * width
    strips = Strips()
    at = wp.vec2(0.0, 0.0)
    along = wp.vec2(1.0, 0.0)
    for k in range(_MAX_LEGS):
        if k <= corners:
            length = wp.lerp(q.corridor_leg[0], q.corridor_leg[1], wp.randf(state))
            has_dead_end = wp.randf(state) < q.corridor_dead_end_share
            dead_end = wp.lerp(q.corridor_dead_end[0], q.corridor_dead_end[1], wp.randf(state))
            place = wp.randf(state)
            if corners == 0:
                length = 2.0 * length
                if has_dead_end:
                    # Beside a straight corridor.
                    beside = at + wp.lerp(0.25, 0.75, place) * length * along + h * _rotated(along, side)
                    strips = _with_strip(
                        strips, beside, _rotated(along, side), wp.vec3(dead_end, _NARROW, 0.0)
                    )
            if k == 1 and corners == 2:
                # Room for walls between the first leg and the third.
                length = wp.max(length, width + p.wall_thickness + 0.1)
            usable = wp.where(k < corners, length - p.corner_clearance, length + width)
            strips = _with_strip(strips, at, along, wp.vec3(length + width, h, usable))
            at += (length + width) * along
            if k < corners:
                if has_dead_end:
                    # Straight on at the corner.
                    strips = _with_strip(strips, at, along, wp.vec3(dead_end, h, 0.0))
                # The next leg begins beside the corner.
                turn = wp.where(k == 1 and not is_u, -side, side)
                at -= h * along
                along = _rotated(along, turn)
                at += h * along
    return strips


@wp.func
def build_corridor(world: int, p: ParamsStruct, q: FamilyStruct, seed: int, site: Site, slots: Slots) -> Site:
    """A corridor of one width: straight, L, Z or U, with obstacles as in `corridors`."""
    state = wp.rand_init(seed, 0)
    width = wp.lerp(p.width, p.easy_width, wp.randf(state))
    height = wp.lerp(p.wall_height[0], p.wall_height[1], wp.randf(state))
    per_m = wp.lerp(q.corridor_obstacles_per_m[0], q.corridor_obstacles_per_m[1], wp.randf(state))
    strips = _draw_strips(width, p, q, seed)
    now = site
    for i in range(strips.count):
        line = strips.lines[i]
        begin = wp.vec2(line[0], line[1])
        along = wp.vec2(line[2], line[3])
        end = begin + strips.sizes[i, 0] * along
        across = strips.sizes[i, 1] * wp.vec2(wp.abs(along[1]), wp.abs(along[0]))
        low = wp.min(begin, end) - across
        high = wp.max(begin, end) + across
        now = with_rectangle(now, low[0], low[1], high[0], high[1])
    middle = middle_of(now)
    now = shifted(now, -middle)
    now = put_walls(world, p.wall_thickness, height, now, slots)

    used = Used()
    used.boxes = 0
    used.cylinders = 0
    used.obstacles = 0
    for i in range(strips.count):
        line = strips.lines[i]
        stretch = Stretch()
        stretch.origin = wp.vec2(line[0], line[1]) - middle
        stretch.along = wp.vec2(line[2], line[3])
        stretch.width = width
        stretch.begin = p.same_side_gap
        stretch.end = strips.sizes[i, 2] - p.same_side_gap
        stretch.first_side = 0.0
        room = stretch.end - stretch.begin
        if room > 0.5:
            used = place_obstacles(
                world,
                int(per_m * room + wp.randf(state)),
                stretch,
                p,
                int(wp.rand_init(seed, 10 + i)),
                used,
                now.first_box,
                now.first_cylinder,
                slots,
            )
    now.boxes = used.boxes
    now.cylinders = used.cylinders
    now.obstacles = used.obstacles
    return now
