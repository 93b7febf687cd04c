# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportCallIssue=false
# pyright: reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Tables with an object to pick up, for all worlds at once, on the device.

Source: SPIN paper, "Training environments" of the pick task: a table of random height with one of several
objects, the robot beside it. Sizes and ranges are this project's, see `TabletopParams` and
docs/manipulation.md.
"""

import warp as wp

from spin_rl.scenes.layout import Layout, PoolSpec
from spin_rl.scenes.objects.model import CYLINDER, SHAPE_OF_KIND, ObjectStart
from spin_rl.scenes.objects.shapes import KINDS
from spin_rl.scenes.tabletops.params import TabletopParams, TabletopStruct, tabletop_struct
from spin_rl.scenes.tabletops.start_pose import (
    HAND_X_M,
    between,
    either_way,
    far_start,
    look_at,
    near_start,
)
from spin_rl.warp_kernels.slots import Slots, put_slot, slots_of

NUM_WALLS = 4

_NUM_KINDS = wp.constant(len(KINDS))
_HALF = wp.constant(
    wp.types.matrix(shape=(len(KINDS), 3), dtype=float)(
        *(h for kind in KINDS.values() for h in kind.half_extents)
    )
)
_MASS = wp.constant(wp.types.vector(length=len(KINDS), dtype=float)(*(kind.mass for kind in KINDS.values())))
_HAND_X = wp.constant(HAND_X_M)
_EDGE_MIN = wp.constant(0.38)
"""Distance of the table's near edge, so that the base can turn."""
_REACH = wp.constant(1.3)
"""What is farther than this from the origin is out of the robot's reach."""

wp.set_module_options({"enable_backward": False})


def generate_tabletops(
    layout: Layout,
    obj: ObjectStart,
    params: TabletopParams,
    *,
    seed: wp.array,
    counter: wp.array,
    mask: wp.array,
    level: wp.array,
    near_share: wp.array,
    kind_choice: wp.array,
) -> None:
    """Draw a new table, object, surroundings and start for the masked worlds; graph-safe.

    The draw depends on nothing but the seed, the world's index and its counter, which goes up by one. The
    table is the first box slot, a solid block from the floor to its top. The layout's goal is where the
    object starts.

    Args:
        layout: Output.
        obj: Output, what the object is and where it starts, `ObjectState.start`.
        params: Distribution to draw from; its values are frozen when a graph is captured.
        seed: Random seed, shape (1,), int32.
        counter: Scenes drawn so far, shape (nworld,), int32; updated in place.
        mask: Worlds to rewrite, shape (nworld,), bool.
        level: Curriculum in [0, 1], shape (nworld,): with half of it as probability, a start that is not
            near has the lift anywhere, else somewhat above the object's height.
        near_share: Probability of a near start, shape (nworld,).
        kind_choice: Index into `objects.OBJECTS`, -1 any, shape (nworld,), int32.

    Raises:
        ValueError: If the pool is too small.
    """
    _require_pool(layout.pool)
    wp.launch(
        _generate_tabletops,
        dim=layout.nworld,
        inputs=[
            tabletop_struct(params),
            layout.pool.first_box,
            layout.pool.num_boxes,
            seed,
            mask,
            level,
            near_share,
            kind_choice,
        ],
        outputs=[counter, slots_of(layout), obj, layout.start, layout.start_joints, layout.goal],
        device=layout.device,
    )


def _require_pool(pool: PoolSpec) -> None:
    if pool.num_walls < NUM_WALLS:
        raise ValueError(f"pool.num_walls must be at least {NUM_WALLS} for tabletops, got {pool.num_walls}")
    if pool.num_boxes < 1:
        raise ValueError(f"pool.num_boxes must be at least 1 for tabletops, got {pool.num_boxes}")


@wp.func
def size_of(kind: int, factor: float) -> wp.vec3:
    """Half extents of a kind of object, times a factor [m]."""
    return factor * wp.vec3(_HALF[kind, 0], _HALF[kind, 1], _HALF[kind, 2])


@wp.func
def mass_of(kind: int, factor: float) -> float:
    """Mass of a kind of object, times a factor [kg]."""
    return _MASS[kind] * factor


@wp.func
def radius_of(kind: int, half: wp.vec3) -> float:
    """Radius of the upright cylinder around an object, whichever way it is turned [m]."""
    if SHAPE_OF_KIND[kind] == CYLINDER:
        return half[0]  # pyright: ignore[reportReturnType] - to a type checker, maybe a row of a matrix
    return wp.length(wp.vec2(half[0], half[1]))


@wp.func
def _put_surroundings(
    world: int, first_box: int, boxes: int, back: float, p: TabletopStruct, state: wp.uint32, slots: Slots
) -> None:
    """Write walls and boxes out of the robot's reach; `back` is how far the table extends to -y."""
    for i in range(wp.static(NUM_WALLS)):
        there = wp.randf(state) < p.wall_share
        distance = _REACH + 1.5 * wp.randf(state)
        height = wp.lerp(1.0, 2.2, wp.randf(state))
        if i == 3:
            distance = wp.max(distance, back)
        # Ahead, left, behind, right.
        yaw = 0.5 * wp.pi * float(i)
        if there:
            centre = wp.vec3((distance + 0.05) * wp.cos(yaw), (distance + 0.05) * wp.sin(yaw), 0.5 * height)
            put_slot(world, i, centre, yaw, wp.vec3(0.05, 2.5, 0.5 * height), slots)
    count = int(float(p.max_distractors + 1) * wp.randf(state))
    for i in range(wp.min(count, boxes - 1)):
        half = wp.vec3(
            wp.lerp(0.1, 0.5, wp.randf(state)),
            wp.lerp(0.1, 0.4, wp.randf(state)),
            wp.lerp(0.1, 0.8, wp.randf(state)),
        )
        angle = either_way(wp.pi, wp.randf(state))
        distance = _REACH + wp.length(wp.vec2(half[0], half[1])) + 1.5 * wp.randf(state)
        turn = either_way(wp.pi, wp.randf(state))
        centre = wp.vec3(distance * wp.cos(angle), distance * wp.sin(angle), half[2])
        put_slot(world, first_box + 1 + i, centre, turn, half, slots)


@wp.kernel
def _generate_tabletops(
    # Parameters
    p: TabletopStruct,
    first_box: int,
    boxes: int,
    # In
    seed: wp.array(dtype=wp.int32),
    mask: wp.array(dtype=bool),
    level: wp.array(dtype=float),
    near_share: wp.array(dtype=float),
    kind_choice: wp.array(dtype=wp.int32),
    # Out
    counter_out: wp.array(dtype=wp.int32),
    slots: Slots,
    obj: ObjectStart,
    start_out: wp.array(dtype=wp.vec3),
    start_joints_out: wp.array2d(dtype=float),
    goal_out: wp.array(dtype=wp.vec2),
) -> None:
    world = wp.tid()
    if not mask[world]:
        return
    # One number per world and draw; every subject below hashes it with a number of its own.
    stream = int(wp.rand_init(int(wp.rand_init(seed[0], world)), counter_out[world]))
    counter_out[world] = counter_out[world] + 1
    for slot in range(slots.active.shape[1]):
        slots.active[world, slot] = False

    # The object.
    state = wp.rand_init(stream, 0)
    kind = wp.min(int(float(_NUM_KINDS) * wp.randf(state)), _NUM_KINDS - 1)
    if kind_choice[world] >= 0:
        kind = kind_choice[world]
    half = size_of(kind, between(p.size_factor, wp.randf(state)))
    radius = radius_of(kind, half)
    top = between(p.table_top, wp.randf(state))
    distance = between(p.object_distance, wp.randf(state))
    target = wp.vec3(_HAND_X, -distance, top + half[2])
    obj.kind[world] = kind
    obj.half_extents[world] = half
    obj.mass[world] = mass_of(kind, between(p.mass_factor, wp.randf(state)))
    obj.friction[world] = between(p.friction, wp.randf(state))
    obj.start_pose[world] = wp.vec4(target[0], target[1], target[2], either_way(wp.pi, wp.randf(state)))
    goal_out[world] = wp.vec2(target[0], target[1])

    # The table, turned about the object.
    length = between(p.table_half_length, wp.randf(state))
    depth = between(p.table_half_depth, wp.randf(state))
    inset_min = wp.min(radius + p.edge_margin, depth)
    inset_max = wp.max(wp.min(2.0 * depth - inset_min, distance - _EDGE_MIN), inset_min)
    inset = wp.lerp(inset_min, inset_max, wp.randf(state))
    aside = either_way(wp.max(length - inset_min, 0.0), wp.randf(state))
    turn = either_way(p.table_yaw, wp.randf(state))
    c = wp.cos(turn)
    s = wp.sin(turn)
    centre = wp.vec3(
        target[0] + c * aside - s * (inset - depth), target[1] + s * aside + c * (inset - depth), 0.5 * top
    )
    put_slot(world, first_box, centre, turn, wp.vec3(length, depth, 0.5 * top), slots)

    # The robot.
    state = wp.rand_init(stream, 1)
    near = wp.randf(state) < near_share[world]
    obj.near[world] = near
    if near:
        start = near_start(p, wp.rand_init(stream, 2), target, radius, top)
    else:
        start = far_start(
            p,
            wp.rand_init(stream, 2),
            wp.clamp(level[world], 0.0, 1.0),
            target,
            radius,
            distance - inset,
            top,
        )
    start = look_at(p, wp.rand_init(stream, 4), target, start)
    start_out[world] = start.base
    for j in range(8):
        start_joints_out[world, j] = start.joints[j]
    _put_surroundings(
        world, first_box, boxes, depth + wp.abs(centre[1]) + 0.2, p, wp.rand_init(stream, 3), slots
    )
