# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Furnished rooms: one, or several with doorways between them, as Warp functions."""

import warp as wp

from spin_rl.scenes.corridors.struct import ParamsStruct
from spin_rl.scenes.motion import Track
from spin_rl.scenes.rooms.arrange import draw_density, furnish
from spin_rl.scenes.rooms.geometry import Site, middle_of, shifted, with_rectangle, with_reserved
from spin_rl.scenes.rooms.struct import FamilyStruct
from spin_rl.scenes.rooms.walker import put_walker
from spin_rl.scenes.rooms.walls import put_partition, put_walls
from spin_rl.warp_kernels.slots import Slots

_NARROWEST = wp.constant(2.0)
"""Least width of a wing or of one of several rooms [m]."""

_DOOR_DEPTH = wp.constant(0.8)
"""Floor that stays free on either side of a doorway [m]."""

_BESIDE_DOOR = wp.constant(0.1)
"""And beside it [m]."""

wp.set_module_options({"enable_backward": False})


@wp.func
def _furnish_all(world: int, q: FamilyStruct, seed: int, site: Site, slots: Slots, track: Track) -> Site:
    """Furniture in all rectangles, and somebody who walks in one of them."""
    state = wp.rand_init(seed, 1)
    density = draw_density(q, wp.randf(state), wp.randf(state))
    where = wp.min(int(float(site.num_rectangles) * wp.randf(state)), site.num_rectangles - 1)
    now = put_walker(world, site.rectangles[where], q, int(wp.rand_init(seed, 9)), site, slots, track)
    for i in range(site.num_rectangles):
        now = furnish(world, i, density, q, int(wp.rand_init(seed, 2 + i)), now, slots)
    return now


@wp.func
def build_room(
    world: int, p: ParamsStruct, q: FamilyStruct, seed: int, site: Site, slots: Slots, track: Track
) -> Site:
    """One room, some with a wing at its right side."""
    state = wp.rand_init(seed, 0)
    x = wp.lerp(q.room_size[0], q.room_size[1], wp.randf(state))
    y = wp.lerp(q.room_size[0], q.room_size[1], wp.randf(state))
    height = wp.lerp(p.wall_height[0], p.wall_height[1], wp.randf(state))
    has_wing = wp.randf(state) < q.room_wing_share
    wing = wp.vec2(
        wp.lerp(_NARROWEST, 3.5, wp.randf(state)),
        wp.lerp(_NARROWEST, wp.max(0.7 * y, _NARROWEST), wp.randf(state)),
    )
    now = with_rectangle(site, 0.0, 0.0, x, y)
    if has_wing:
        # In a corner of the room or in the middle of its side.
        begin = 0.5 * (y - wing[1]) * float(wp.min(int(3.0 * wp.randf(state)), 2))
        now = with_rectangle(now, x, begin, x + wing[0], begin + wing[1])
    now = shifted(now, -middle_of(now))
    now = put_walls(world, p.wall_thickness, height, now, slots)
    return _furnish_all(world, q, seed, now, slots, track)


@wp.func
def _draw_door(u: float, v: float, low: float, high: float, q: FamilyStruct) -> wp.vec2:
    width = wp.lerp(q.doorway_door_width[0], q.doorway_door_width[1], u)
    begin = wp.lerp(low + _BESIDE_DOOR, high - _BESIDE_DOOR - width, v)
    return wp.vec2(begin, begin + width)


@wp.func
def build_doorway(
    world: int, p: ParamsStruct, q: FamilyStruct, seed: int, site: Site, slots: Slots, track: Track
) -> Site:
    """Two rooms, or three of which the third is in a row with them or cut off the second one across."""
    state = wp.rand_init(seed, 0)
    x = 0.5 * wp.lerp(q.doorway_length[0], q.doorway_length[1], wp.randf(state))
    y = 0.5 * wp.lerp(q.doorway_width[0], q.doorway_width[1], wp.randf(state))
    height = wp.lerp(p.wall_height[0], p.wall_height[1], wp.randf(state))
    three = wp.randf(state) < q.doorway_three_share
    across = wp.randf(state) < 0.5
    split = wp.randf(state)
    t = p.wall_thickness
    now = put_walls(world, t, height, with_rectangle(site, -x, -y, x, y), slots)
    now.num_rectangles = 0

    line = wp.lerp(-0.3, 0.3, split) * x
    in_row = three and not across and 2.0 * x >= 3.0 * _NARROWEST + 2.0 * t
    if in_row:
        line = wp.lerp(-x + _NARROWEST, x - 2.0 * (_NARROWEST + t), split)
    door = _draw_door(wp.randf(state), wp.randf(state), -y, y, q)
    now = put_partition(world, 1, line, wp.vec2(-y, y), door, t, height, now, slots)
    now = with_reserved(
        now, line - _DOOR_DEPTH, door[0] - _BESIDE_DOOR, line + _DOOR_DEPTH, door[1] + _BESIDE_DOOR
    )
    now = with_rectangle(now, -x, -y, line - 0.5 * t, y)
    low = line + 0.5 * t

    u = wp.randf(state)
    v = wp.randf(state)
    w = wp.randf(state)
    if in_row:
        second = wp.lerp(low + _NARROWEST, x - t - _NARROWEST, w)
        door = _draw_door(u, v, -y, y, q)
        now = put_partition(world, 1, second, wp.vec2(-y, y), door, t, height, now, slots)
        now = with_reserved(
            now, second - _DOOR_DEPTH, door[0] - _BESIDE_DOOR, second + _DOOR_DEPTH, door[1] + _BESIDE_DOOR
        )
        now = with_rectangle(now, low, -y, second - 0.5 * t, y)
        now = with_rectangle(now, second + 0.5 * t, -y, x, y)
    elif three and door[0] + y > _NARROWEST + t:
        # Below the first door, so that it does not open onto the partition.
        second = wp.lerp(-y + _NARROWEST, door[0] - 0.2 - 0.5 * t, w)
        second = wp.max(wp.min(second, door[0] - 0.1 - 0.5 * t), -y + 0.5 * _NARROWEST)
        door = _draw_door(u, v, low, x, q)
        now = put_partition(world, 0, second, wp.vec2(low, x), door, t, height, now, slots)
        now = with_reserved(
            now, door[0] - _BESIDE_DOOR, second - _DOOR_DEPTH, door[1] + _BESIDE_DOOR, second + _DOOR_DEPTH
        )
        now = with_rectangle(now, low, -y, x, second - 0.5 * t)
        now = with_rectangle(now, low, second + 0.5 * t, x, y)
    else:
        now = with_rectangle(now, low, -y, x, y)
    return _furnish_all(world, q, seed, now, slots, track)
