# pyright: reportGeneralTypeIssues=false
# (to a type checker, a Warp struct is an object, not a class)
"""Cluttered corridors with up to two corners and with dead ends, as a Warp function."""

import warp as wp

from spin_rl.scenes.corridors.clutter import Stretch, Used, place_obstacles
from spin_rl.scenes.corridors.params import ParamsStruct
from spin_rl.scenes.rooms.geometry import Site, centred
from spin_rl.scenes.rooms.params import FamilyStruct
from spin_rl.scenes.rooms.walls import put_walls
from spin_rl.warp_kernels.slots import Slots

_MAX_LEGS = wp.constant(3)

wp.set_module_options({"enable_backward": False})


@wp.func
def _with_strip(
    site: Site, origin: wp.vec2, along: wp.vec2, begin: float, end: float, half_width: float
) -> Site:
    """The site and the strip around a centre line ``origin + s * along``, begin <= s <= end."""
    a = origin + begin * along
    b = origin + end * along
    across = half_width * wp.vec2(wp.abs(along[1]), wp.abs(along[0]))
    low = wp.min(a, b) - across
    high = wp.max(a, b) + across
    grown = site
    rectangles = grown.rectangles
    rectangles[grown.num_rectangles] = wp.vec4(low[0], low[1], high[0], high[1])
    grown.rectangles = rectangles
    grown.num_rectangles = grown.num_rectangles + 1
    return grown


@wp.func
def _rotated(along: wp.vec2, side: float) -> wp.vec2:
    """A direction turned by 90 degrees to a side (1 left, -1 right)."""
    return wp.vec2(-side * along[1], side * along[0])


@wp.func
def build_corridor(world: int, p: ParamsStruct, q: FamilyStruct, seed: int, site: Site, slots: Slots) -> Site:
    """Legs of one width with 0, 1 or 2 corners: straight, L, Z or U; obstacles as in `corridors`."""
    state = wp.rand_init(seed, 0)
    width = wp.lerp(p.width, p.easy_width, wp.randf(state))
    height = wp.lerp(p.wall_height[0], p.wall_height[1], wp.randf(state))
    few = q.corridor_corners[0]
    corners = wp.min(
        few + int(float(q.corridor_corners[1] - few + 1) * wp.randf(state)), q.corridor_corners[1]
    )
    per_m = wp.lerp(q.corridor_obstacles_per_m[0], q.corridor_obstacles_per_m[1], wp.randf(state))
    side = wp.where(wp.randf(state) < 0.5, -1.0, 1.0)
    is_u = wp.randf(state) < 0.5
    h = 0.5 * width

    # Legs run from corner to corner; each owns the corner at its end, the next begins beside it.
    now = site
    at = wp.vec2(0.0, 0.0)
    along = wp.vec2(1.0, 0.0)
    for k in range(_MAX_LEGS):
        if k <= corners:
            length = wp.lerp(q.corridor_leg[0], q.corridor_leg[1], wp.randf(state))
            if corners == 0:
                length = 2.0 * length
            if k == 1 and corners == 2:
                # Room for walls and dead ends between the first leg and the third.
                length = wp.max(length, 2.0 * width + p.wall_thickness + 0.1)
            begin = wp.where(k == 0, -h, h)
            now = _with_strip(now, at, along, begin, length + h, h)
            at += length * along
            spur = wp.randf(state) < q.corridor_dead_end_share
            spur_length = wp.lerp(q.corridor_dead_end[0], q.corridor_dead_end[1], wp.randf(state))
            place = wp.randf(state)
            if spur and corners == 0:
                # Beside a straight corridor.
                beside = at - wp.lerp(0.25, 0.75, place) * length * along
                now = _with_strip(now, beside, _rotated(along, side), h, h + spur_length, 0.45)
            if k < corners:
                if spur:
                    # Straight on at the corner.
                    now = _with_strip(now, at, along, h, h + spur_length, h)
                turn = side
                if k == 1 and not is_u:
                    turn = -side
                along = _rotated(along, turn)
    now = centred(now)
    now = put_walls(world, p.wall_thickness, height, now, slots)
    return _put_obstacles(world, per_m, width, p, seed, now, slots)


@wp.func
def _put_obstacles(
    world: int, per_m: float, width: float, p: ParamsStruct, seed: int, site: Site, slots: Slots
) -> Site:
    """Obstacles in every strip, clear of its ends by half the width, where another one may join."""
    used = Used()
    used.boxes = 0
    used.cylinders = 0
    used.obstacles = 0
    for i in range(site.num_rectangles):
        r = site.rectangles[i]
        stretch = Stretch()
        size = wp.vec2(r[2] - r[0], r[3] - r[1])
        stretch.along = wp.vec2(1.0, 0.0)
        stretch.origin = wp.vec2(r[0], 0.5 * (r[1] + r[3]))
        length = size[0]
        if size[1] > size[0]:
            stretch.along = wp.vec2(0.0, 1.0)
            stretch.origin = wp.vec2(0.5 * (r[0] + r[2]), r[1])
            length = size[1]
        stretch.width = width
        stretch.begin = width + p.corner_clearance
        stretch.end = length - width - p.corner_clearance
        stretch.first_side = 0.0
        draw = wp.rand_init(seed, 10 + i)
        wanted = int(per_m * (stretch.end - stretch.begin) + wp.randf(draw))
        if wp.min(size[0], size[1]) > width - 1.0e-3 and stretch.end - stretch.begin > 0.4:
            used = place_obstacles(
                world,
                wanted,
                stretch,
                p,
                int(wp.rand_init(seed, 20 + i)),
                used,
                site.first_box,
                site.first_cylinder,
                slots,
            )
    now = site
    now.boxes = used.boxes
    now.cylinders = used.cylinders
    now.obstacles = used.obstacles
    return now
