# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportArgumentType=false
# pyright: reportOperatorIssue=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Scenes of all families for all worlds at once, on the device.

In two steps, since a start must be able to reach the goal: the first writes walls, furniture, what moves, and
the goal; the second takes the ways to that goal and writes the start pose. Of the corridors some are the
paper's, by `scenes/corridors`, which come with a start.
"""

import warp as wp

from spin_rl.scenes.corridors.generator import generate_layouts
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
from spin_rl.scenes.rooms.shuttle import build_shuttle, shuttle_ends, shuttle_start
from spin_rl.scenes.rooms.start import draw_joints, place_starts
from spin_rl.scenes.rooms.struct import FamilyStruct, family_struct
from spin_rl.warp_kernels.distance_field.field import Field
from spin_rl.warp_kernels.slots import Slots, slots_of

_CORRIDOR = wp.constant(FAMILIES.index("corridor"))
_ROOM = wp.constant(FAMILIES.index("room"))
_DOORWAY = wp.constant(FAMILIES.index("doorway"))
_FIELD = wp.constant(FAMILIES.index("field"))
_CROSSING = wp.constant(FAMILIES.index("crossing"))
_SHUTTLE = wp.constant(FAMILIES.index("shuttle"))
_LAST = wp.constant(len(FAMILIES) - 1)

_GOAL_TRIES = wp.constant(48)

# Unrolled loops with all the furniture inlined in them would take minutes to compile.
wp.set_module_options({"enable_backward": False, "max_unroll": 1})


class FamilyGenerator:
    """Draws scenes of all families into a layout; both methods only launch kernels and are graph-safe.

    A draw depends on nothing but the seed, the world's index and its counter.
    """

    def __init__(self, layout: Layout, params: FamilyParams) -> None:
        """Allocate what the steps of a draw tell each other.

        Args:
            layout: Where scenes are written.
            params: Distribution to draw from; its values are frozen when a graph is captured.

        Raises:
            ValueError: The layout's pool is not that of the parameters.
        """
        if layout.pool != params.pool:
            raise ValueError(f"scene.pool is {params.pool}, the layout has {layout.pool}")
        self._layout = layout
        self._params = params
        with wp.ScopedDevice(layout.device):
            self._is_paper = wp.zeros(layout.nworld, dtype=bool)
            self._paper_counter = wp.zeros(layout.nworld, dtype=wp.int32)
            self._any_scenario = wp.zeros(layout.nworld, dtype=wp.int32)
            self._any_difficulty = wp.full(layout.nworld, -1, dtype=wp.int32)
            self._full_level = wp.full(layout.nworld, 1.0, dtype=float)

    def build(
        self, *, seed: wp.array, counter: wp.array, mask: wp.array, family_choice: wp.array | None = None
    ) -> None:
        """Draw family, walls, furniture, motion and goal of the masked worlds' new scenes.

        What moves is where it reaches farthest, as `restart_motion` expects it. All lies within +- 6 m.

        Args:
            seed: Random seed, shape (1,), int32.
            counter: Scenes drawn so far, shape (nworld,), int32; goes up by one where masked.
            mask: Worlds to rewrite, shape (nworld,), bool.
            family_choice: Index of `kinds.FAMILIES`, -1 by shares, shape (nworld,), int32; None is -1
                everywhere.
        """
        layout, params = self._layout, self._params
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
                layout.start,
                layout.start_joints,
                layout.has_via,
                layout.via,
                layout.way_m,
                self._is_paper,
                self._paper_counter,
            ],
            device=layout.device,
        )
        if params.shares.corridor > 0.0 and params.corridor.paper_share > 0.0:
            generate_layouts(
                layout,
                params.paper,
                seed=seed,
                counter=self._paper_counter,
                mask=self._is_paper,
                scenario_choice=self._any_scenario,
                difficulty_choice=self._any_difficulty,
                level=self._full_level,
            )

    def place_starts(self, field: Field, *, seed: wp.array, counter: wp.array, mask: wp.array) -> None:
        """Draw start poses of the masked worlds from which there is a way to the goal, where none is yet.

        Args:
            field: Ways to the goals of the masked worlds.
            seed: Random seed, shape (1,), int32.
            counter: Scenes drawn so far, the present ones included, shape (nworld,), int32.
            mask: Worlds to write, shape (nworld,), bool.
        """
        draw = {"seed": seed, "counter": counter, "mask": mask, "has_start": self._is_paper}
        place_starts(self._layout, self._params, field, **draw)


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
    start_out: wp.array(dtype=wp.vec3),
    start_joints_out: wp.array2d(dtype=float),
    has_via_out: wp.array(dtype=bool),
    via_out: wp.array(dtype=wp.vec2),
    way_out: wp.array(dtype=float),
    is_paper_out: wp.array(dtype=bool),
    paper_counter_out: wp.array(dtype=wp.int32),
) -> None:
    world = wp.tid()
    is_paper_out[world] = False
    if not mask[world]:
        return
    # One number per world and draw; every subject below hashes it with a number of its own.
    stream = int(wp.rand_init(int(wp.rand_init(seed[0], world)), counter[world]))
    # Another stream than the one here: negative counters occur nowhere else.
    paper_counter_out[world] = -1 - counter[world]
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
    while family < _LAST and u >= q.shares[family]:
        family += 1
    if family_choice.shape[0] > 0 and family_choice[world] >= 0:
        family = family_choice[world]
    inner = int(wp.rand_init(stream, 1))
    family_out[world] = family
    has_via_out[world] = family == _SHUTTLE
    if family == _CORRIDOR and wp.randf(wp.rand_init(stream, 3)) < q.corridor_paper_share:
        is_paper_out[world] = True
        return
    if family == _CORRIDOR:
        site = build_corridor(world, p, q, inner, site, slots)
    elif family == _ROOM:
        site = build_room(world, p, q, inner, site, slots, track)
    elif family == _DOORWAY:
        site = build_doorway(world, p, q, inner, site, slots, track)
    elif family == _FIELD:
        site = build_field(world, p, q, inner, site, slots, track)
    elif family == _CROSSING:
        site = build_crossing(world, p, q, inner, site, slots, track)
    elif family == _SHUTTLE:
        site = build_shuttle(world, p, q, inner, site, slots, track)
    if site.num_rectangles == 0:
        site = with_rectangle(site, -HALF_OPEN, -HALF_OPEN, HALF_OPEN, HALF_OPEN)
    if family == _SHUTTLE:
        # It comes with its start.
        ends = shuttle_ends(q, inner)
        via_out[world] = wp.vec2(ends[0], 0.0)
        goal_out[world] = wp.vec2(ends[1], 0.0)
        way_out[world] = 2.0 * ends[0] - ends[1]
        start_out[world] = shuttle_start(inner)
        joints = draw_joints(p, int(wp.rand_init(stream, 4)), 0)
        for j in range(8):
            start_joints_out[world, j] = wp.where(j == 0 or j >= 6, joints[j], p.stowed[j])
    else:
        goal_out[world] = _draw_goal(
            world, p.goal_clearance, int(wp.rand_init(stream, 2)), site, slots, track
        )
    bend_out[world] = 0
    scenario_out[world] = 0
    difficulty_out[world] = 0
    num_obstacles_out[world] = site.obstacles
