# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Scenes of all families for all worlds at once, on the device.

In two steps, since a start must be able to reach the goal: `build_scenes` writes walls, furniture, what
moves, and the goal; `place_starts` of `start.py` takes the ways to that goal and writes the start pose.
"""

import warp as wp

from spin_rl.scenes.corridors.struct import ParamsStruct, params_struct
from spin_rl.scenes.kinds import FAMILIES
from spin_rl.scenes.layout import Layout
from spin_rl.scenes.motion import Track, track_of
from spin_rl.scenes.rooms.corridor import build_corridor
from spin_rl.scenes.rooms.crossing import build_crossing
from spin_rl.scenes.rooms.field import build_field
from spin_rl.scenes.rooms.geometry import HALF_OPEN, Site, is_calm, spot_clearance, with_rectangle
from spin_rl.scenes.rooms.params import FamilyParams
from spin_rl.scenes.rooms.room import build_doorway, build_room
from spin_rl.scenes.rooms.struct import FamilyStruct, family_struct
from spin_rl.warp_kernels.slots import Slots, slots_of

_CORRIDOR = wp.constant(FAMILIES.index("corridor"))
_ROOM = wp.constant(FAMILIES.index("room"))
_DOORWAY = wp.constant(FAMILIES.index("doorway"))
_FIELD = wp.constant(FAMILIES.index("field"))
_CROSSING = wp.constant(FAMILIES.index("crossing"))

_GOAL_TRIES = wp.constant(48)

# Unrolled loops with all the furniture inlined in them would take minutes to compile.
wp.set_module_options({"enable_backward": False, "max_unroll": 1})


def build_scenes(
    layout: Layout,
    params: FamilyParams,
    *,
    seed: wp.array,
    counter: wp.array,
    mask: wp.array,
    family_choice: wp.array | None = None,
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
        family_choice: Index of `kinds.FAMILIES`, -1 by shares, shape (nworld,), int32; None is -1 everywhere.

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
            family_choice,
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


@wp.func
def _draw_goal(world: int, clearance: float, seed: int, site: Site, slots: Slots, track: Track) -> wp.vec2:
    """A random spot on the floor with the clearance, or the one with most of it that was drawn."""
    state = wp.rand_init(seed, 0)
    best = wp.vec2(0.0, 0.0)
    most = float(-1.0)
    for _try in range(_GOAL_TRIES):
        if most < clearance:
            i = wp.min(int(float(site.num_rectangles) * wp.randf(state)), site.num_rectangles - 1)
            r = site.rectangles[i]
            x = wp.lerp(r[0], r[2], wp.randf(state))
            y = wp.lerp(r[1], r[3], wp.randf(state))
            if is_calm(world, x, y, slots, track):
                room = spot_clearance(world, x, y, clearance, slots)
                if room > most:
                    most = room
                    best = wp.vec2(x, y)
    return best


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
    family_choice: wp.array(dtype=wp.int32),
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
    if family_choice.shape[0] > 0 and family_choice[world] >= 0:
        family = family_choice[world]
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
        site = with_rectangle(site, -HALF_OPEN, -HALF_OPEN, HALF_OPEN, HALF_OPEN)
    goal_out[world] = _draw_goal(world, p.goal_clearance, int(wp.rand_init(stream, 2)), site, slots, track)
    family_out[world] = family
    bend_out[world] = 0
    scenario_out[world] = 1
    difficulty_out[world] = 0
    num_obstacles_out[world] = site.obstacles
