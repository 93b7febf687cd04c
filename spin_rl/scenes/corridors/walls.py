# pyright: reportGeneralTypeIssues=false
# (to a type checker, a Warp struct is an object, not a class)
"""Walls of straight and L-shaped corridors, as Warp functions.

The path starts at the origin along +x. An L turns by 90 degrees after `first_leg`, to +y (side = 1) or -y
(side = -1). Walls bound the free space exactly: they touch each other and do not overlap.
"""

import warp as wp

from spin_rl.warp_kernels.slots import Slots, put_slot

wp.set_module_options({"enable_backward": False})


@wp.func
def _put_wall(
    world: int,
    slot: int,
    low: wp.vec2,
    high: wp.vec2,
    side: float,
    height: float,
    slots: Slots,
) -> None:
    """Write a wall that fills a rectangle of the floor, mirrored in y for side = -1."""
    centre = 0.5 * (low + high)
    half = 0.5 * (high - low)
    put_slot(
        world,
        slot,
        wp.vec3(centre[0], side * centre[1], 0.5 * height),
        0.0,
        wp.vec3(half[0], half[1], 0.5 * height),
        slots,
    )


@wp.func
def put_straight_walls(
    world: int,
    width: float,
    behind: float,
    end: float,
    thickness: float,
    height: float,
    slots: Slots,
) -> None:
    """Write the walls around -behind <= x <= end, |y| <= width / 2: left, right, back, front."""
    h = 0.5 * width
    t = thickness
    x0 = -behind - t
    x1 = end + t
    _put_wall(world, 0, wp.vec2(x0, h), wp.vec2(x1, h + t), 1.0, height, slots)
    _put_wall(world, 1, wp.vec2(x0, h), wp.vec2(x1, h + t), -1.0, height, slots)
    _put_wall(world, 2, wp.vec2(x0, -h), wp.vec2(-behind, h), 1.0, height, slots)
    _put_wall(world, 3, wp.vec2(end, -h), wp.vec2(x1, h), 1.0, height, slots)


@wp.func
def put_bent_walls(
    world: int,
    width: float,
    behind: float,
    first_leg: float,
    end: float,
    side: float,
    thickness: float,
    height: float,
    slots: Slots,
) -> None:
    """Write the walls of an L: inner and outer of the first leg, inner and outer of the second, back, front.

    The first leg is free for -behind <= x <= first_leg + width / 2, the second for y up to ``end`` (times
    side).
    """
    h = 0.5 * width
    t = thickness
    x0 = -behind - t
    inner = first_leg - h
    outer = first_leg + h
    y1 = end + t
    _put_wall(world, 0, wp.vec2(x0, h), wp.vec2(inner, h + t), side, height, slots)
    _put_wall(world, 1, wp.vec2(x0, -h - t), wp.vec2(outer + t, -h), side, height, slots)
    _put_wall(world, 2, wp.vec2(inner - t, h + t), wp.vec2(inner, y1), side, height, slots)
    _put_wall(world, 3, wp.vec2(outer, -h), wp.vec2(outer + t, y1), side, height, slots)
    _put_wall(world, 4, wp.vec2(x0, -h), wp.vec2(-behind, h), side, height, slots)
    _put_wall(world, 5, wp.vec2(inner, end), wp.vec2(outer, y1), side, height, slots)
