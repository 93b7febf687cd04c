# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Walls around a floor of rectangles, and partitions with an opening, as Warp functions."""

import warp as wp

from spin_rl.scenes.rooms.geometry import Site
from spin_rl.warp_kernels.slots import Slots, put_slot

_TOUCH = wp.constant(1.0e-4)
_MAX_PIECES = wp.constant(4)
"""Most pieces of wall along one side of a rectangle."""

wp.set_module_options({"enable_backward": False})


@wp.func
def _overlaps_floor(site: Site, low: wp.vec2, high: wp.vec2) -> bool:
    for i in range(site.num_rectangles):
        r = site.rectangles[i]
        if r[0] < high[0] - _TOUCH and r[2] > low[0] + _TOUCH:
            if r[1] < high[1] - _TOUCH and r[3] > low[1] + _TOUCH:
                return True
    return False


@wp.func
def put_wall(world: int, low: wp.vec2, high: wp.vec2, height: float, site: Site, slots: Slots) -> Site:
    """Write a wall that fills a rectangle of the floor, if a slot is left."""
    now = site
    if now.walls < now.first_box and high[0] - low[0] > _TOUCH and high[1] - low[1] > _TOUCH:
        centre = 0.5 * (low + high)
        half = 0.5 * (high - low)
        put_slot(
            world,
            now.walls,
            wp.vec3(centre[0], centre[1], 0.5 * height),
            0.0,
            wp.vec3(half[0], half[1], 0.5 * height),
            slots,
        )
        now.walls = now.walls + 1
    return now


@wp.func
def put_walls(world: int, thickness: float, height: float, site: Site, slots: Slots) -> Site:
    """Write the walls around a floor whose rectangles share sides but do not overlap.

    Walls stand outside, with openings where rectangles meet; those along x fill the outer corners.
    """
    now = site
    for i in range(site.num_rectangles):
        r = site.rectangles[i]
        for side in range(4):
            # The side runs from a to b along axis k, at `line` on the other axis, outwards along `out`.
            k = side % 2
            out = wp.where(side < 2, -1.0, 1.0)
            line = wp.where(side < 2, r[1 - k], r[3 - k])
            a = r[k]
            b = r[k + 2]
            cursor = float(a)
            for _piece in range(_MAX_PIECES):
                if cursor < b - _TOUCH:
                    # The next opening from the cursor on.
                    low = float(b)
                    high = float(b)
                    for j in range(site.num_rectangles):
                        q = site.rectangles[j]
                        facing = wp.where(side < 2, q[3 - k], q[1 - k])
                        begins = wp.max(q[k], cursor)
                        if j != i and wp.abs(facing - line) < _TOUCH and begins < low:
                            if wp.min(q[k + 2], b) > begins + _TOUCH:
                                low = begins
                                high = wp.min(q[k + 2], b)
                    begin = float(cursor)
                    end = float(low)
                    near = wp.min(line, line + out * thickness)
                    far = wp.max(line, line + out * thickness)
                    if k == 0 and low > cursor + _TOUCH:
                        if cursor == a and not _overlaps_floor(
                            site, wp.vec2(a - thickness, near), wp.vec2(a, far)
                        ):
                            begin = a - thickness
                        if low == b and not _overlaps_floor(
                            site, wp.vec2(b, near), wp.vec2(b + thickness, far)
                        ):
                            end = b + thickness
                    if low > cursor + _TOUCH:
                        if k == 0:
                            now = put_wall(world, wp.vec2(begin, near), wp.vec2(end, far), height, now, slots)
                        else:
                            now = put_wall(world, wp.vec2(near, begin), wp.vec2(far, end), height, now, slots)
                    cursor = high
    return now


@wp.func
def put_partition(
    world: int,
    axis: int,
    line: float,
    ends: wp.vec2,
    door: wp.vec2,
    thickness: float,
    height: float,
    site: Site,
    slots: Slots,
) -> Site:
    """Write a wall along an axis (0 x, 1 y), centred on a line, from ends[0] to ends[1] without the door."""
    t = 0.5 * thickness
    now = site
    if axis == 0:
        now = put_wall(world, wp.vec2(ends[0], line - t), wp.vec2(door[0], line + t), height, now, slots)
        return put_wall(world, wp.vec2(door[1], line - t), wp.vec2(ends[1], line + t), height, now, slots)
    now = put_wall(world, wp.vec2(line - t, ends[0]), wp.vec2(line + t, door[0]), height, now, slots)
    return put_wall(world, wp.vec2(line - t, door[1]), wp.vec2(line + t, ends[1]), height, now, slots)
