# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportCallIssue=false
# pyright: reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Start poses from which there is a way to the goal."""

import warp as wp

from spin_rl.scenes.corridors.struct import ParamsStruct, params_struct
from spin_rl.scenes.footprint import pose_is_clear, vec8
from spin_rl.scenes.kinds import FAMILIES
from spin_rl.scenes.layout import Layout
from spin_rl.scenes.motion import Track, track_of
from spin_rl.scenes.rooms.crossing import half_width_of_hall
from spin_rl.scenes.rooms.geometry import HALF_OPEN, is_calm, spot_clearance
from spin_rl.scenes.rooms.params import FamilyParams
from spin_rl.warp_kernels.distance_field.field import Field, cell_centre, field_at
from spin_rl.warp_kernels.slots import Slots, slots_of

_DOORWAY = wp.constant(FAMILIES.index("doorway"))
_CROSSING = wp.constant(FAMILIES.index("crossing"))

_ROOMY = wp.constant(0.6)
"""More clearance than this makes no spot better [m]."""

_TURNING = wp.constant(0.35)
"""Clearance at which the base can turn on the spot [m]."""

_FAR = wp.constant(0.6)
"""How much of the range of ways the least one asked for can take."""

_STRIDE = wp.constant(7)
"""Where every drawn start fails, every so many cells of the field is tried."""

wp.set_module_options({"enable_backward": False, "max_unroll": 1})


def place_starts(
    layout: Layout,
    params: FamilyParams,
    field: Field,
    *,
    seed: wp.array,
    counter: wp.array,
    mask: wp.array,
    has_start: wp.array,
) -> None:
    """Draw start poses of the masked worlds from which there is a way to the goal; graph-safe.

    Args:
        layout: Scenes without a start; `start`, `start_joints` and `way_m` are the output.
        params: Length of the way, clearance and joints at the start.
        field: Ways to the goals of the masked worlds.
        seed: Random seed, shape (1,), int32.
        counter: Scenes drawn so far, the present ones included, shape (nworld,), int32.
        mask: Worlds to write, shape (nworld,), bool.
        has_start: Those of them of which only `way_m` is to be written, shape (nworld,), bool.
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
            has_start,
            layout.has_via,
            layout.family,
            layout.goal,
            slots_of(layout),
            track_of(layout),
        ],
        outputs=[layout.start, layout.start_joints, layout.way_m],
        device=layout.device,
    )


@wp.func
def _floor_bounds(world: int, first_box: int, half_square: float, slots: Slots) -> wp.vec4:
    """Bounding rectangle of a world's walls, of the whole square without any."""
    low = wp.vec2(half_square, half_square)
    high = wp.vec2(-half_square, -half_square)
    for slot in range(first_box):
        if slots.active[world, slot]:
            pos = slots.pos[world, slot]
            half = slots.half_size[world, slot]
            low = wp.min(low, wp.vec2(pos[0] - half[0], pos[1] - half[1]))
            high = wp.max(high, wp.vec2(pos[0] + half[0], pos[1] + half[1]))
    if low[0] >= high[0]:
        return wp.vec4(-half_square, -half_square, half_square, half_square)
    return wp.vec4(low[0], low[1], high[0], high[1])


@wp.func
def _wall_between(world: int, a: wp.vec2, b: wp.vec2, first_box: int, slots: Slots) -> bool:
    """Whether a wall stands on the straight line between two spots."""
    for slot in range(first_box):
        if slots.active[world, slot]:
            # Walls lie along the axes: the line is inside over the overlap of two intervals.
            enter = float(0.0)
            leave = float(1.0)
            for k in range(2):
                low = slots.pos[world, slot][k] - slots.half_size[world, slot][k]
                high = slots.pos[world, slot][k] + slots.half_size[world, slot][k]
                way = b[k] - a[k]
                if wp.abs(way) < 1.0e-6:
                    if a[k] < low or a[k] > high:
                        leave = -1.0
                else:
                    enter = wp.max(enter, wp.min((low - a[k]) / way, (high - a[k]) / way))
                    leave = wp.min(leave, wp.max((low - a[k]) / way, (high - a[k]) / way))
            if enter < leave:
                return True
    return False


@wp.func
def draw_joints(p: ParamsStruct, seed: int, index: int) -> vec8:
    """Random joints within the start ranges, in `robot.JOINTS` order."""
    state = wp.rand_init(seed, index)
    joints = vec8()
    for j in range(8):
        joints[j] = wp.lerp(p.start_low[j], p.start_high[j], wp.randf(state))
    return joints


@wp.func
def _turned_clear(
    world: int, spot: wp.vec2, joints: vec8, yaw: float, margin: float, slots: Slots
) -> wp.vec4:
    """A pose at a spot, turned until it is clear: (x, y, yaw, 1 if it is)."""
    for i in range(8):
        pose = wp.vec3(spot[0], spot[1], yaw + 0.25 * wp.pi * float(i))
        if pose_is_clear(world, pose, joints, margin, slots):
            return wp.vec4(pose[0], pose[1], pose[2], 1.0)
    return wp.vec4(spot[0], spot[1], yaw, 0.0)


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
    has_start: wp.array(dtype=bool),
    has_via: wp.array(dtype=bool),
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
    if not mask[world] or has_via[world]:  # it comes with start and way
        return
    if has_start[world]:
        way_out[world] = field_at(field, world, start_out[world][0], start_out[world][1])
        return
    stream = int(wp.rand_init(int(wp.rand_init(seed[0], world)), counter[world] - 1))
    joints_seed = int(wp.rand_init(stream, 4))
    state = wp.rand_init(stream, 3)
    bounds = _floor_bounds(world, first_box, HALF_OPEN, slots)
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
                    fits = fits and _wall_between(world, wp.vec2(x, y), goal[world], first_box, slots)
            fits = fits and spot_clearance(world, x, y, _TURNING, slots) >= _TURNING
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
        turned = _turned_clear(
            world, best, joints, wp.pi * (2.0 * wp.randf(state) - 1.0), p.start_clearance, slots
        )
        start = wp.vec3(turned[0], turned[1], turned[2])
    start_out[world] = start
    for j in range(8):
        start_joints_out[world, j] = joints[j]
    way_out[world] = field_at(field, world, start[0], start[1])
