# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Halls with side openings out of which things move, as a Warp function."""

import warp as wp

from spin_rl.scenes.corridors.struct import ParamsStruct
from spin_rl.scenes.motion import Track
from spin_rl.scenes.rooms.arrange import draw_density, furnish
from spin_rl.scenes.rooms.geometry import Site, with_rectangle, with_reserved
from spin_rl.scenes.rooms.struct import FamilyStruct
from spin_rl.scenes.rooms.walls import put_wall, put_walls
from spin_rl.warp_kernels.slots import Slots, put_slot

_MAX_STATIONS = wp.constant(4)
"""Most places along the hall with an opening on one side or on both."""

_LEAST_REACH = wp.constant(0.3)
"""How far into the hall a mover comes at least [m]."""

_BESIDE = wp.constant(0.1)
"""Floor beside an opening where nothing may be put [m]."""

wp.set_module_options({"enable_backward": False})


@wp.func
def _put_mover(
    world: int,
    x: float,
    side: float,
    half_width: float,
    most_reach: float,
    lane: float,
    p: ParamsStruct,
    q: FamilyStruct,
    seed: int,
    site: Site,
    slots: Slots,
    track: Track,
) -> Site:
    """Write what comes out of an opening at x on a side (1 or -1), at most so far into the hall."""
    state = wp.rand_init(seed, 0)
    half = wp.vec2(
        wp.lerp(q.crossing_half_size[0], q.crossing_half_size[1], wp.randf(state)),
        wp.lerp(q.crossing_half_size[0], q.crossing_half_size[1], wp.randf(state)),
    )
    height = wp.lerp(0.25, 1.7, wp.randf(state))
    reach = wp.lerp(_LEAST_REACH, most_reach, wp.randf(state))
    u = wp.randf(state)
    patrols = wp.randf(state) < q.crossing_patrolling_share
    phase = wp.randf(state)
    trigger = wp.lerp(q.crossing_trigger[0], q.crossing_trigger[1], wp.randf(state))
    speed = wp.lerp(q.crossing_speed[0], q.crossing_speed[1], wp.randf(state))
    low = float(0.0)
    floats = wp.rand_init(seed, 1)
    if wp.randf(floats) < q.crossing_floating_share:
        low = wp.lerp(p.head_bottom[0], p.head_bottom[1], wp.randf(floats))
        height = wp.lerp(p.head_thickness[0], p.head_thickness[1], wp.randf(floats))
    now = site
    slot = now.first_box + now.boxes
    if wp.randf(state) < 0.4 and now.first_cylinder + now.cylinders < now.num_slots:
        slot = now.first_cylinder + now.cylinders
        half = wp.vec2(half[0], half[0])
        now.cylinders = now.cylinders + 1
    else:
        now.boxes = now.boxes + 1
    # Behind the wall it is between close to it and at the lane's far side.
    home = side * (half_width - reach + half[1])
    nearest = half_width + p.wall_thickness + half[1] + 0.02
    farthest = half_width + p.wall_thickness + lane - half[1] - 0.05
    back = side * wp.lerp(nearest, wp.max(farthest, nearest), u)
    centre = wp.vec3(x, home, low + 0.5 * height)
    put_slot(world, slot, centre, 0.0, wp.vec3(half[0], half[1], 0.5 * height), slots)
    track.home[world, slot] = centre
    track.retreat[world, slot] = wp.vec2(0.0, back - home)
    track.speed[world, slot] = speed
    track.trigger[world, slot] = wp.where(patrols, 0.0, trigger)
    track.phase[world, slot] = wp.where(patrols, phase, 0.0)
    now.obstacles = now.obstacles + 1
    return now


@wp.func
def build_crossing(
    world: int, p: ParamsStruct, q: FamilyStruct, seed: int, site: Site, slots: Slots, track: Track
) -> Site:
    """A hall along x between two lanes; stations along it, each with an opening left, right or both."""
    state = wp.rand_init(seed, 0)
    x = 0.5 * wp.lerp(q.crossing_length[0], q.crossing_length[1], wp.randf(state))
    half_width = 0.5 * wp.lerp(q.crossing_width[0], q.crossing_width[1], wp.randf(state))
    lane = wp.lerp(q.crossing_lane[0], q.crossing_lane[1], wp.randf(state))
    height = wp.lerp(p.wall_height[0], p.wall_height[1], wp.randf(state))
    fewest = q.crossing_stations[0]
    most = q.crossing_stations[1]
    stations = wp.min(fewest + int(float(most - fewest + 1) * wp.randf(state)), most)
    t = p.wall_thickness
    outer = half_width + t + lane
    now = put_walls(world, t, height, with_rectangle(site, -x, -outer, x, outer), slots)
    now.num_rectangles = 0
    now = with_rectangle(now, -x, -half_width, x, half_width)
    now = with_rectangle(now, -x, half_width + t, x, outer)
    now = with_rectangle(now, -x, -outer, x, -half_width - t)

    spacing = 2.0 * x / float(stations)
    left = float(-x)  # where the next piece of either wall begins
    right = float(-x)
    for k in range(_MAX_STATIONS):
        if k < stations:
            opening = wp.lerp(q.crossing_opening[0], q.crossing_opening[1], wp.randf(state))
            middle = -x + spacing * (float(k) + wp.lerp(0.35, 0.65, wp.randf(state)))
            sides = wp.randf(state)  # a third each: left, right, both
            begin = middle - 0.5 * opening
            end = middle + 0.5 * opening
            most_reach = 2.0 * half_width - q.gap
            if sides > 0.667:
                most_reach = 0.5 * most_reach
            free = wp.max(0.5 * opening + _BESIDE, q.crossing_half_size[1] + q.gap)
            now = with_reserved(now, middle - free, -outer, middle + free, outer)
            if sides < 0.333 or sides > 0.667:
                now = put_wall(
                    world, wp.vec2(left, half_width), wp.vec2(begin, half_width + t), height, now, slots
                )
                left = end
                if wp.randf(state) < q.crossing_mover_share:
                    now = _put_mover(
                        world,
                        middle,
                        1.0,
                        half_width,
                        most_reach,
                        lane,
                        p,
                        q,
                        int(wp.rand_init(seed, 10 + k)),
                        now,
                        slots,
                        track,
                    )
            if sides > 0.333:
                now = put_wall(
                    world, wp.vec2(right, -half_width - t), wp.vec2(begin, -half_width), height, now, slots
                )
                right = end
                if wp.randf(state) < q.crossing_mover_share:
                    now = _put_mover(
                        world,
                        middle,
                        -1.0,
                        half_width,
                        most_reach,
                        lane,
                        p,
                        q,
                        int(wp.rand_init(seed, 20 + k)),
                        now,
                        slots,
                        track,
                    )
    now = put_wall(world, wp.vec2(left, half_width), wp.vec2(x, half_width + t), height, now, slots)
    now = put_wall(world, wp.vec2(right, -half_width - t), wp.vec2(x, -half_width), height, now, slots)

    furniture = wp.rand_init(seed, 1)
    density = draw_density(q, wp.randf(furniture), wp.randf(furniture))
    for i in range(now.num_rectangles):
        now = furnish(world, i, density, q, int(wp.rand_init(seed, 2 + i)), now, slots)
    # Whoever crosses may stand in an opening: start and goal are in the hall.
    now.num_rectangles = 1
    return now


@wp.func
def half_width_of_hall(world: int, slots: Slots) -> float:
    """Half the width of a crossing's hall [m]: its walls come after the four around everything."""
    return wp.abs(slots.pos[world, 4][1]) - slots.half_size[world, 4][1]
