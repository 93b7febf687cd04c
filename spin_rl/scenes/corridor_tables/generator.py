# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportOperatorIssue=false
# pyright: reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Corridors with a table and an object at their end, for all worlds at once, on the device.

Source: SPIN paper, "Simulation results": reach, pick and place in the corridors of `generator.py`. Place and
size of the table are this project's, see `FetchTableParams`.
"""

import warp as wp

from spin_rl.scenes.corridor_tables.params import FetchSceneParams, FetchTableStruct, table_struct
from spin_rl.scenes.corridors.generator import generate_layouts
from spin_rl.scenes.layout import Layout
from spin_rl.scenes.objects.model import ObjectStart
from spin_rl.scenes.objects.shapes import OBJECTS
from spin_rl.scenes.tabletops.generator import mass_of, radius_of, size_of
from spin_rl.scenes.tabletops.start_pose import between, either_way
from spin_rl.warp_kernels.slots import Slots, put_slot, slots_of

_NUM_KINDS = wp.constant(len(OBJECTS))

wp.set_module_options({"enable_backward": False})


def generate_fetch_scenes(
    layout: Layout,
    obj: ObjectStart,
    params: FetchSceneParams,
    *,
    seed: wp.array,
    counter: wp.array,
    mask: wp.array,
    scenario_choice: wp.array,
    difficulty_choice: wp.array,
    level: wp.array,
    kind_choice: wp.array,
) -> None:
    """Draw a new corridor, table and object for the masked worlds; graph-safe.

    The corridor is that of `generate_layouts` with the same arguments; the table stands across its end,
    beyond the goal, as a solid block from the floor to its top in the slot `params.table_slot`.

    Args:
        layout: Output, with the pool `params.pool`.
        obj: Output, what the object is and where it starts, `ObjectState.start`.
        params: Distribution to draw from; its values are frozen when a graph is captured.
        seed: Random seed, shape (1,), int32.
        counter: Scenes drawn so far, shape (nworld,), int32; updated in place.
        mask: Worlds to rewrite, shape (nworld,), bool.
        scenario_choice: See `generate_layouts`, as are the two that follow.
        difficulty_choice: Likewise.
        level: Likewise.
        kind_choice: Index into `objects.OBJECTS`, -1 any, shape (nworld,), int32.

    Raises:
        ValueError: If the pool is too small.
    """
    if layout.pool.num_boxes < params.pool.num_boxes:
        raise ValueError(
            f"pool.num_boxes must be at least {params.pool.num_boxes} for fetch scenes, "
            f"got {layout.pool.num_boxes}"
        )
    generate_layouts(
        layout,
        params.corridor,
        seed=seed,
        counter=counter,
        mask=mask,
        scenario_choice=scenario_choice,
        difficulty_choice=difficulty_choice,
        level=level,
    )
    wp.launch(
        _put_tables,
        dim=layout.nworld,
        inputs=[
            table_struct(params.table),
            params.table_slot,
            seed,
            counter,
            mask,
            kind_choice,
            layout.bend,
            layout.goal,
        ],
        outputs=[slots_of(layout), obj],
        device=layout.device,
    )


@wp.kernel
def _put_tables(
    # Parameters
    p: FetchTableStruct,
    slot: int,
    # In
    seed: wp.array(dtype=wp.int32),
    counter: wp.array(dtype=wp.int32),
    mask: wp.array(dtype=bool),
    kind_choice: wp.array(dtype=wp.int32),
    bend: wp.array(dtype=wp.int32),
    goal: wp.array(dtype=wp.vec2),
    # Out
    slots: Slots,
    obj: ObjectStart,
) -> None:
    world = wp.tid()
    if not mask[world]:
        return
    # The stream of the corridor's draw, whose subjects have other numbers.
    stream = int(wp.rand_init(int(wp.rand_init(seed[0], world)), counter[world] - 1))
    state = wp.rand_init(stream, 5)
    along = wp.vec2(1.0, 0.0)
    if bend[world] != 0:
        along = wp.vec2(0.0, wp.sign(goal[world][1]))
    across = wp.vec2(-along[1], along[0])

    kind = wp.min(int(float(_NUM_KINDS) * wp.randf(state)), _NUM_KINDS - 1)
    if kind_choice[world] >= 0:
        kind = kind_choice[world]
    half = size_of(kind, between(p.size_factor, wp.randf(state)))
    margin = radius_of(kind, half) + p.edge_margin
    top = between(p.top, wp.randf(state))
    depth = between(p.depth, wp.randf(state))
    width = between(p.half_width, wp.randf(state))
    edge = goal[world] + between(p.edge_distance, wp.randf(state)) * along
    inset = wp.min(between(p.inset, wp.randf(state)), depth - margin)
    aside = either_way(wp.max(wp.min(p.aside, width - margin), 0.0), wp.randf(state))
    at = edge + inset * along + aside * across
    obj.kind[world] = kind
    obj.half_extents[world] = half
    obj.mass[world] = mass_of(kind, between(p.mass_factor, wp.randf(state)))
    obj.friction[world] = between(p.friction, wp.randf(state))
    obj.start_pose[world] = wp.vec4(at[0], at[1], top + half[2], either_way(wp.pi, wp.randf(state)))
    obj.near[world] = False

    centre = edge + 0.5 * depth * along
    put_slot(
        world,
        slot,
        wp.vec3(centre[0], centre[1], 0.5 * top),
        wp.atan2(along[1], along[0]),
        wp.vec3(0.5 * depth, width, 0.5 * top),
        slots,
    )
