# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Boxes and posts on an open floor, as a Warp function."""

import warp as wp

from spin_rl.scenes.corridors.clutter import draw_heights
from spin_rl.scenes.corridors.struct import ParamsStruct
from spin_rl.scenes.motion import Track
from spin_rl.scenes.rooms.arrange import draw_close, place_is_free
from spin_rl.scenes.rooms.geometry import Site
from spin_rl.scenes.rooms.struct import FamilyStruct
from spin_rl.scenes.rooms.walker import put_walker
from spin_rl.warp_kernels.slots import Slots, put_slot

_TRIES = wp.constant(12)
# Kinds of `draw_heights`.
_LOW = wp.constant(0)
_TALL = wp.constant(1)
_ARM = wp.constant(2)
_HEAD = wp.constant(3)

wp.set_module_options({"enable_backward": False})


@wp.func
def build_field(
    world: int, p: ParamsStruct, q: FamilyStruct, seed: int, site: Site, slots: Slots, track: Track
) -> Site:
    """Things at random places with gaps between them: a third thin posts, others low, tall or floating."""
    state = wp.rand_init(seed, 0)
    half_side = 0.5 * wp.lerp(q.field_size[0], q.field_size[1], wp.randf(state))
    floor = wp.vec4(-half_side, -half_side, half_side, half_side)
    now = put_walker(world, floor, q, int(wp.rand_init(seed, 2)), site, slots, track)
    count = q.field_things[0] + int(float(q.field_things[1] - q.field_things[0] + 1) * wp.randf(state))
    for k in range(wp.min(count, q.field_things[1])):
        draw = wp.rand_init(int(wp.rand_init(seed, 1)), k)
        is_post = wp.randf(draw) < 0.33
        is_round = wp.randf(draw) < 0.5
        u = wp.randf(draw)
        half = wp.vec2(wp.lerp(0.06, 0.4, u * u), wp.lerp(0.06, 0.3, wp.randf(draw)))
        kind = _LOW
        if wp.randf(draw) < q.field_floating_share:
            kind = wp.where(wp.randf(draw) < 0.4, _ARM, _HEAD)
        elif wp.randf(draw) < 0.4:
            kind = _TALL
        if is_post:
            kind = _TALL
            half = wp.vec2(wp.lerp(0.015, 0.06, u), wp.lerp(0.015, 0.06, wp.randf(draw)))
        z = draw_heights(kind, wp.randf(draw), wp.randf(draw), p)
        # A post may be as low as a stool or as high as a wall.
        if is_post:
            z = wp.vec2(0.0, wp.lerp(0.3, 1.8, wp.randf(draw)))
        on_floor = z[0] == 0.0
        slot = now.first_box + now.boxes
        boxes_left = slot < now.first_cylinder
        cylinder = now.first_cylinder + now.cylinders
        as_cylinder = cylinder < now.num_slots and ((is_round and on_floor) or not boxes_left)
        if as_cylinder:
            slot = cylinder
            half = wp.vec2(half[0], half[0])
        close = draw_close(q, wp.randf(draw))
        placed = bool(False)
        for _attempt in range(_TRIES):
            if not placed and (as_cylinder or boxes_left):
                centre = wp.vec2(
                    half_side * (2.0 * wp.randf(draw) - 1.0), half_side * (2.0 * wp.randf(draw) - 1.0)
                )
                yaw = wp.pi * (2.0 * wp.randf(draw) - 1.0)
                placed = place_is_free(world, centre, yaw, half, q.gap, close, now, slots)
                if placed:
                    put_slot(
                        world,
                        slot,
                        wp.vec3(centre[0], centre[1], 0.5 * (z[0] + z[1])),
                        yaw,
                        wp.vec3(half[0], half[1], 0.5 * (z[1] - z[0])),
                        slots,
                    )
        if placed:
            now.obstacles = now.obstacles + 1
            if as_cylinder:
                now.cylinders = now.cylinders + 1
            else:
                now.boxes = now.boxes + 1
    return now
