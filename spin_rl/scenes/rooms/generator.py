# pyright: reportGeneralTypeIssues=false
# (to a type checker, a Warp struct is an object, not a class)
"""Scenes of all families for all worlds at once, on the device.

In two steps, since a start must be able to reach the goal: `build_scenes` writes walls, furniture, what
moves, and the goal; `place_starts` takes the ways to that goal and writes the start pose.
"""

import warp as wp

from spin_rl.scenes.corridors.params import ParamsStruct, params_struct
from spin_rl.scenes.footprint import pose_is_clear
from spin_rl.scenes.kinds import FAMILIES
from spin_rl.scenes.layout import Layout
from spin_rl.scenes.motion import Track, track_of
from spin_rl.scenes.rooms.corridor import build_corridor
from spin_rl.scenes.rooms.crossing import build_crossing, half_width_of_hall
from spin_rl.scenes.rooms.field import build_field
from spin_rl.scenes.rooms.geometry import Site, spot_clearance, with_rectangle
from spin_rl.scenes.rooms.params import HALF_SQUARE_M, FamilyParams, FamilyStruct, family_struct
from spin_rl.scenes.rooms.placement import (
    draw_goal,
    draw_joints,
    floor_bounds,
    is_calm,
    turned_clear,
    wall_between,
)
from spin_rl.scenes.rooms.room import build_doorway, build_room
from spin_rl.warp_kernels.distance_field.field import Field, cell_centre, field_at
from spin_rl.warp_kernels.slots import Slots, slots_of

_CORRIDOR = wp.constant(FAMILIES.index("corridor"))
_ROOM = wp.constant(FAMILIES.index("room"))
_DOORWAY = wp.constant(FAMILIES.index("doorway"))
_FIELD = wp.constant(FAMILIES.index("field"))
_CROSSING = wp.constant(FAMILIES.index("crossing"))

_HALF_OPEN = wp.constant(HALF_SQUARE_M - 0.4)
"""Half the side of the square for start and goal where there are no walls."""

_ROOMY = wp.constant(0.6)
"""More clearance than this makes no spot better [m]."""

_FAR = wp.constant(0.6)
"""How much of the range of ways the least one asked for can take."""

_STRIDE = wp.constant(7)
"""Where every drawn start fails, every so many cells of the field is tried."""

wp.set_module_options({"enable_backward": False})


def build_scenes(
    layout: Layout, params: FamilyParams, *, seed: wp.array, counter: wp.array, mask: wp.array
) -> None:
    """Draw family, walls, furniture, motion and goal of the masked worlds' new scenes; graph-safe.

    The draw depends on nothing but the seed, the world's index and its counter, which goes up by one. What
    moves is where it reaches farthest, as `restart_motion` expects it. Everything lies within +- 6 m.

    Args:
        layout: Output; `start`, `start_joints` and `way_m` are `place_starts`'.
        params: Distribution to draw from; its values are frozen when a graph is captured.
        seed: Random seed, shape (1,), int32.
        counter: Scenes drawn so far, shape (nworld,), int32; updated in place.
        mask: Worlds to rewrite, shape (nworld,), bool.

    Raises:
        ValueError: The layout's pool is not that of the parameters.
    """
    if layout.pool != params.pool:
        raise ValueError(f"scene.pool is {params.pool}, the layout has {layout.pool}")
    wp.launch(
        _build,
        dim=layout.nworld,
        inputs=[
            params_struct(params),
            family_struct(params),
            layout.pool.first_box,
            layout.pool.first_cylinder,
            seed,
            mask,
        ],
        outputs=[
            counter,
            slots_of(layout),
            track_of(layout),
            layout.family,
            layout.goal,
            layout.bend,
            layout.scenario,
            layout.difficulty,
            layout.num_obstacles,
        ],
        device=layout.device,
    )


def place_starts(
    layout: Layout,
    params: FamilyParams,
    field: Field,
    *,
    seed: wp.array,
    counter: wp.array,
    mask: wp.array,
) -> None:
    """Draw start poses of the masked worlds from which there is a way to the goal; graph-safe.

    Args:
        layout: Scenes of `build_scenes`; `start`, `start_joints` and `way_m` are the output.
        params: Length of the way, clearance and joints at the start.
        field: Ways to the goals of the masked worlds.
        seed: Random seed, shape (1,), int32.
        counter: Scenes drawn so far, the present ones included, shape (nworld,), int32.
        mask: Worlds to write, shape (nworld,), bool.
    """
    wp.launch(
        _place,
        dim=layout.nworld,
        inputs=[
            params_struct(params),
            wp.vec2(*params.way),
            layout.pool.first_box,
            field,
            seed,
            counter,
            mask,
            layout.family,
            layout.goal,
            slots_of(layout),
            track_of(layout),
        ],
        outputs=[layout.start, layout.start_joints, layout.way_m],
        device=layout.device,
    )


@wp.kernel
def _build(
    # Parameters
    p: ParamsStruct,
    q: FamilyStruct,
    first_box: int,
    first_cylinder: int,
    # In
    seed: wp.array(dtype=wp.int32),
    mask: wp.array(dtype=bool),
    # In and out
    counter: wp.array(dtype=wp.int32),
    # Out
    slots: Slots,
    track: Track,
    family_out: wp.array(dtype=wp.int32),
    goal_out: wp.array(dtype=wp.vec2),
    bend_out: wp.array(dtype=wp.int32),
    scenario_out: wp.array(dtype=wp.int32),
    difficulty_out: wp.array(dtype=wp.int32),
    num_obstacles_out: wp.array(dtype=wp.int32),
) -> None:
    world = wp.tid()
    if not mask[world]:
        return
    # One number per world and draw; every subject below hashes it with a number of its own.
    stream = int(wp.rand_init(int(wp.rand_init(seed[0], world)), counter[world]))
    counter[world] = counter[world] + 1
    site = Site()
    site.first_box = first_box
    site.first_cylinder = first_cylinder
    site.num_slots = slots.active.shape[1]
    for slot in range(site.num_slots):
        slots.active[world, slot] = False
        track.speed[world, slot] = 0.0

    u = wp.randf(wp.rand_init(stream, 0))
    family = int(0)
    # A share of 0 is never drawn, not even the last one.
    while family < 5 and u >= q.shares[family]:
        family += 1
    inner = int(wp.rand_init(stream, 1))
    if family == _CORRIDOR:
        site = build_corridor(world, p, q, inner, site, slots)
    elif family == _ROOM:
        site = build_room(world, p, q, inner, site, slots)
    elif family == _DOORWAY:
        site = build_doorway(world, p, q, inner, site, slots)
    elif family == _FIELD:
        site = build_field(world, p, q, inner, site, slots)
    elif family == _CROSSING:
        site = build_crossing(world, p, q, inner, site, slots, track)
    if site.num_rectangles == 0:
        site = with_rectangle(site, -_HALF_OPEN, -_HALF_OPEN, _HALF_OPEN, _HALF_OPEN)
    goal_out[world] = draw_goal(world, p.goal_clearance, int(wp.rand_init(stream, 2)), site, slots, track)
    family_out[world] = family
    bend_out[world] = 0
    scenario_out[world] = 1
    difficulty_out[world] = 0
    num_obstacles_out[world] = site.obstacles


@wp.kernel
def _place(
    # Parameters
    p: ParamsStruct,
    way: wp.vec2,
    first_box: int,
    # In
    field: Field,
    seed: wp.array(dtype=wp.int32),
    counter: wp.array(dtype=wp.int32),
    mask: wp.array(dtype=bool),
    family: wp.array(dtype=wp.int32),
    goal: wp.array(dtype=wp.vec2),
    slots: Slots,
    track: Track,
    # Out
    start_out: wp.array(dtype=wp.vec3),
    start_joints_out: wp.array2d(dtype=float),
    way_out: wp.array(dtype=float),
) -> None:
    world = wp.tid()
    if not mask[world]:
        return
    stream = int(wp.rand_init(int(wp.rand_init(seed[0], world)), counter[world] - 1))
    joints_seed = int(wp.rand_init(stream, 4))
    state = wp.rand_init(stream, 3)
    bounds = floor_bounds(world, first_box, _HALF_OPEN, slots)
    if family[world] == _CROSSING:
        hall = half_width_of_hall(world, slots)
        bounds = wp.vec4(bounds[0], -hall, bounds[2], hall)
    joints = draw_joints(p, joints_seed, 0)
    start = wp.vec3(0.0, 0.0, 0.0)
    # Asked for at first: half of the worlds get ways from a length on, half up to one.
    wanted = wp.vec2(way[0], wp.lerp(way[0] + 0.5, way[1], wp.randf(state)))
    if wp.randf(state) < 0.5:
        wanted = wp.vec2(wp.lerp(way[0], way[1], _FAR * wp.randf(state)), way[1])
    found = bool(False)
    best = goal[world]
    most = float(-1.0)
    for attempt in range(p.start_tries):
        if not found:
            x = wp.lerp(bounds[0], bounds[2], wp.randf(state))
            y = wp.lerp(bounds[1], bounds[3], wp.randf(state))
            yaw = wp.pi * (2.0 * wp.randf(state) - 1.0)
            far = field_at(field, world, x, y)
            fits = far >= way[0] and far < way[1]
            if fits and 2 * attempt < p.start_tries:
                fits = far >= wanted[0] and far < wanted[1]
                # In rooms with doorways the goal shall lie behind a wall.
                if family[world] == _DOORWAY:
                    fits = fits and wall_between(world, wp.vec2(x, y), goal[world], first_box, slots)
            if fits and is_calm(world, x, y, slots, track):
                joints = draw_joints(p, joints_seed, attempt)
                start = wp.vec3(x, y, yaw)
                found = pose_is_clear(world, start, joints, p.start_clearance, slots)
                if not found:
                    room = spot_clearance(world, x, y, _ROOMY, slots)
                    if room > most:
                        most = room
                        best = wp.vec2(x, y)
    if not found:
        columns = field.values.shape[2]
        cells = field.values.shape[1] * columns
        for i in range(cells // _STRIDE):
            if most < _ROOMY:
                row = i * _STRIDE // columns
                column = i * _STRIDE - row * columns
                far = field.values[world, row, column]
                spot = cell_centre(field, world, column, row)
                if far >= way[0] and far < way[1] and spot[1] > bounds[1] and spot[1] < bounds[3]:
                    room = spot_clearance(world, spot[0], spot[1], _ROOMY, slots)
                    if room > most and is_calm(world, spot[0], spot[1], slots, track):
                        most = room
                        best = spot
        stowed = p.stowed
        # The camera looks anywhere in any case: it moves within the head's disc.
        for j in range(6, 8):
            stowed[j] = joints[j]
        joints = stowed
        turned = turned_clear(
            world, best, joints, wp.pi * (2.0 * wp.randf(state) - 1.0), p.start_clearance, slots
        )
        start = wp.vec3(turned[0], turned[1], turned[2])
    start_out[world] = start
    for j in range(8):
        start_joints_out[world, j] = joints[j]
    way_out[world] = field_at(field, world, start[0], start[1])
