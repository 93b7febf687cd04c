# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportOperatorIssue=false
# pyright: reportCallIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Somebody who walks to and fro in a room or across a field, as a Warp function."""

import warp as wp

from spin_rl.scenes.motion import Track
from spin_rl.scenes.rooms.arrange import place_is_free
from spin_rl.scenes.rooms.geometry import Site, with_reserved
from spin_rl.scenes.rooms.struct import FamilyStruct
from spin_rl.warp_kernels.slots import Slots, put_slot

_TRIES = wp.constant(12)
_BESIDE = wp.constant(0.05)
"""Floor beside the walk where nothing may be put [m]."""

_HEIGHT = wp.constant(wp.vec2(1.5, 1.8))

wp.set_module_options({"enable_backward": False})


@wp.func
def put_walker(
    world: int, r: wp.vec4, q: FamilyStruct, seed: int, site: Site, slots: Slots, track: Track
) -> Site:
    """In a share of worlds, one who walks along x or y within a rectangle that nothing stands in yet.

    The walk is kept free, and whatever is put there later leaves room to pass where the walker is at home.

    Args:
        world: World to write.
        r: Floor (low x, low y, high x, high y) [m].
        q: Family parameters.
        seed: Random seed.
        site: What there is so far.
        slots: Output.
        track: Output.

    Returns:
        What there is now.
    """
    now = site
    state = wp.rand_init(seed, 0)
    slot = site.first_box + site.boxes
    placed = wp.randf(state) >= q.walker_share or slot >= site.first_cylinder
    half = wp.vec2(
        wp.lerp(q.walker_half_size[0], q.walker_half_size[1], wp.randf(state)),
        wp.lerp(q.walker_half_size[0], q.walker_half_size[1], wp.randf(state)),
    )
    height = wp.lerp(_HEIGHT[0], _HEIGHT[1], wp.randf(state))
    speed = wp.lerp(q.walker_speed[0], q.walker_speed[1], wp.randf(state))
    phase = wp.randf(state)
    low = wp.vec2(r[0], r[1]) + half
    high = wp.vec2(r[2], r[3]) - half
    for _attempt in range(_TRIES):
        if not placed:
            way = wp.lerp(q.walker_way[0], q.walker_way[1], wp.randf(state))
            home = wp.vec2(
                wp.lerp(low[0], high[0], wp.randf(state)), wp.lerp(low[1], high[1], wp.randf(state))
            )
            away = wp.vec2(way, 0.0)
            if wp.randf(state) < 0.5:
                away = wp.vec2(0.0, way)
            if wp.randf(state) < 0.5:
                away = -away
            end = home + away
            inside = end[0] > low[0] and end[0] < high[0] and end[1] > low[1] and end[1] < high[1]
            if inside and place_is_free(world, home, 0.0, half, q.gap, 0.0, site, slots):
                placed = True
                begin = wp.min(home, end) - half
                finish = wp.max(home, end) + half
                now = with_reserved(
                    now, begin[0] - _BESIDE, begin[1] - _BESIDE, finish[0] + _BESIDE, finish[1] + _BESIDE
                )
                centre = wp.vec3(home[0], home[1], 0.5 * height)
                put_slot(world, slot, centre, 0.0, wp.vec3(half[0], half[1], 0.5 * height), slots)
                track.home[world, slot] = centre
                track.retreat[world, slot] = away
                track.speed[world, slot] = speed
                track.trigger[world, slot] = 0.0
                track.phase[world, slot] = phase
                now.boxes = now.boxes + 1
                now.obstacles = now.obstacles + 1
    return now
