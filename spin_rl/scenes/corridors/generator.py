# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportOperatorIssue=false
# pyright: reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Procedural corridors for all worlds at once, on the device.

Source: SPIN paper, "Training environments" and "Simulation results": a straight corridor 1 m wide and an
L-shaped one, 0-1, 2-3 or 5 obstacles within the 5 m between start and goal, on the floor and floating,
randomized joints and orientation of the robot, and distractors beyond the edges. Sizes and heights are not
given there; see `GeneratorParams` and docs/paper_deviations.md.
"""

import warp as wp

from spin_rl.scenes.corridors.clutter import Stretch, Used, place_obstacles
from spin_rl.scenes.corridors.motion import draw_motion
from spin_rl.scenes.corridors.params import GeneratorParams
from spin_rl.scenes.corridors.start_pose import put_start
from spin_rl.scenes.corridors.struct import ParamsStruct, params_struct
from spin_rl.scenes.corridors.walls import put_bent_walls, put_straight_walls
from spin_rl.scenes.layout import Layout, PoolSpec
from spin_rl.warp_kernels.slots import Slots, put_slot, slots_of

NUM_WALLS = 6

_FRONT = wp.constant(0.0585)
_MIN_PITCH = wp.constant(0.4)
"""Room that one obstacle is counted with when an L's obstacles are divided between its legs."""

wp.set_module_options({"enable_backward": False})


def generate_layouts(
    layout: Layout,
    params: GeneratorParams,
    *,
    seed: wp.array,
    counter: wp.array,
    mask: wp.array,
    scenario_choice: wp.array,
    difficulty_choice: wp.array,
    level: wp.array,
) -> None:
    """Draw a new corridor, clutter, start and goal for the masked worlds; graph-safe.

    The draw depends on nothing but the seed, the world's index and its counter, which goes up by one. The
    start is near the origin, the corridor begins along +x. Obstacles take the first slots of their kind,
    distractors (outside the walls) the last box slots.

    Args:
        layout: Output.
        params: Distribution to draw from; its values are frozen when a graph is captured.
        seed: Random seed, shape (1,), int32.
        counter: Layouts drawn so far, shape (nworld,), int32; updated in place.
        mask: Worlds to rewrite, shape (nworld,), bool.
        scenario_choice: 0 either, 1 straight, 2 L-shaped, shape (nworld,), int32.
        difficulty_choice: -1 any, 0 easy (0-1 obstacles), 1 medium (2-3), 2 hard (`params.hard_obstacles`),
            shape (nworld,), int32.
        level: Curriculum in [0, 1], shape (nworld,): the corridor narrows from `easy_width` to `width`, and
            with any difficulty at most 1 + level * (`params.hard_obstacles` - 1) obstacles are placed.
            Benchmarks use 1.

    Raises:
        ValueError: If the pool is too small.
    """
    _require_pool(layout.pool, params)
    wp.launch(
        _generate,
        dim=layout.nworld,
        inputs=[
            params_struct(params),
            layout.pool.first_box,
            layout.pool.first_cylinder,
            seed,
            mask,
            scenario_choice,
            difficulty_choice,
            level,
        ],
        outputs=[
            counter,
            slots_of(layout),
            layout.start,
            layout.start_joints,
            layout.goal,
            layout.bend,
            layout.scenario,
            layout.difficulty,
            layout.num_obstacles,
        ],
        device=layout.device,
    )
    if params.moves:
        draw_motion(layout, params, seed=seed, counter=counter, mask=mask)


def _require_pool(pool: PoolSpec, params: GeneratorParams) -> None:
    if pool.num_walls < NUM_WALLS:
        raise ValueError(f"pool.num_walls must be at least {NUM_WALLS} for corridors, got {pool.num_walls}")
    if pool.num_boxes < params.hard_obstacles:
        raise ValueError(
            f"pool.num_boxes must be at least {params.hard_obstacles} for corridors, got {pool.num_boxes}"
        )


@wp.func
def _draw_count(difficulty: int, u: float, hard: int) -> int:
    """Obstacles of a difficulty, for a uniform number."""
    if difficulty == 0:
        return int(2.0 * u)
    if difficulty == 1:
        return 2 + int(2.0 * u)
    return hard


@wp.func
def _difficulty_of(count: int) -> int:
    if count <= 1:
        return 0
    if count <= 3:
        return 1
    return 2


@wp.func
def _put_distractors(
    world: int,
    count: int,
    first_box: int,
    first_cylinder: int,
    boxes_used: int,
    seed: int,
    outside: float,
    length: float,
    side: float,
    height: float,
    slots: Slots,
) -> None:
    """Write boxes just outside the wall at t = side * outside, some tall enough to be seen above it."""
    state = wp.rand_init(seed, 3)
    for i in range(count):
        slot = first_cylinder - 1 - i
        half = wp.vec3(
            wp.lerp(0.1, 0.5, wp.randf(state)),
            wp.lerp(0.1, 0.4, wp.randf(state)),
            0.5 * wp.lerp(0.5, 1.5, wp.randf(state)) * height,
        )
        x = wp.lerp(-0.5, length, wp.randf(state))
        y = outside + wp.lerp(0.02, 0.3, wp.randf(state)) + wp.sqrt(half[0] * half[0] + half[1] * half[1])
        turn = wp.lerp(-wp.pi, wp.pi, wp.randf(state))
        if slot >= first_box + boxes_used:
            put_slot(world, slot, wp.vec3(x, side * y, half[2]), turn, half, slots)


@wp.kernel
def _generate(
    # Parameters
    p: ParamsStruct,
    first_box: int,
    first_cylinder: int,
    # In
    seed: wp.array(dtype=wp.int32),
    mask: wp.array(dtype=bool),
    scenario_choice: wp.array(dtype=wp.int32),
    difficulty_choice: wp.array(dtype=wp.int32),
    level: wp.array(dtype=float),
    # Out
    counter_out: wp.array(dtype=wp.int32),
    slots: Slots,
    start_out: wp.array(dtype=wp.vec3),
    start_joints_out: wp.array2d(dtype=float),
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
    stream = int(wp.rand_init(int(wp.rand_init(seed[0], world)), counter_out[world]))
    counter_out[world] = counter_out[world] + 1
    state = wp.rand_init(stream, 0)
    for slot in range(slots.active.shape[1]):
        slots.active[world, slot] = False

    # What to build.
    ease = 1.0 - wp.clamp(level[world], 0.0, 1.0)
    width = p.width + ease * (p.easy_width - p.width)
    scenario = scenario_choice[world]
    drawn_scenario = 1 + int(2.0 * wp.randf(state))
    if scenario == 0:
        scenario = drawn_scenario
    difficulty = difficulty_choice[world]
    drawn_difficulty = wp.min(int(3.0 * wp.randf(state)), 2)
    u = wp.randf(state)
    if difficulty < 0:
        most = 1 + int(float(p.hard_obstacles - 1) * (1.0 - ease) + 0.001)
        count = wp.min(_draw_count(drawn_difficulty, u, p.hard_obstacles), most)
        difficulty = _difficulty_of(count)
    else:
        count = _draw_count(difficulty, u, p.hard_obstacles)
    behind = wp.lerp(p.behind_start[0], p.behind_start[1], wp.randf(state))
    beyond = wp.lerp(p.beyond_goal[0], p.beyond_goal[1], wp.randf(state))
    height = wp.lerp(p.wall_height[0], p.wall_height[1], wp.randf(state))
    first_leg = wp.lerp(p.first_leg[0], p.first_leg[1], wp.randf(state))
    side = wp.where(wp.randf(state) < 0.5, -1.0, 1.0)
    split = wp.randf(state)
    hide = wp.randf(state) < p.corner_share
    distractors = 1 + wp.min(int(float(p.max_distractors) * wp.randf(state)), p.max_distractors - 1)

    used = Used()
    used.boxes = 0
    used.cylinders = 0
    used.obstacles = 0
    first = Stretch()
    first.origin = wp.vec2(0.0, 0.0)
    first.along = wp.vec2(1.0, 0.0)
    first.width = width
    first.begin = _FRONT + p.first_obstacle
    first.first_side = 0.0
    if scenario == 1:
        put_straight_walls(world, width, behind, p.length + beyond, p.wall_thickness, height, slots)
        first.end = p.length - p.goal_clearance
        used = place_obstacles(world, count, first, p, stream, used, first_box, first_cylinder, slots)
        goal_out[world] = wp.vec2(p.length, 0.0)
    else:
        second_leg = p.length - first_leg
        put_bent_walls(
            world, width, behind, first_leg, second_leg + beyond, side, p.wall_thickness, height, slots
        )
        first.end = first_leg - 0.5 * width - p.corner_clearance
        second = Stretch()
        second.origin = wp.vec2(first_leg, 0.0)
        second.along = wp.vec2(0.0, side)
        second.width = width
        second.begin = 0.5 * width + p.same_side_gap
        second.end = second_leg - p.goal_clearance
        second.first_side = 0.0
        if hide:
            # The inner wall of the second leg is on the side to which the corridor turns.
            second.first_side = side
        room_first = first.end - first.begin
        room_second = second.end - second.begin
        # Randomly rounded share of the first leg, within what both legs hold.
        share = float(count) * room_first / (room_first + room_second)
        count_first = wp.min(int(share + split), int(room_first / _MIN_PITCH))
        count_first = wp.max(count_first, count - int(room_second / _MIN_PITCH))
        used = place_obstacles(world, count_first, first, p, stream, used, first_box, first_cylinder, slots)
        used = place_obstacles(
            world, count - count_first, second, p, stream + 1, used, first_box, first_cylinder, slots
        )
        goal_out[world] = wp.vec2(first_leg, side * second_leg)

    # In an L the outer side of the first leg is free; the inner one faces the second leg.
    outer_length = wp.where(scenario == 1, p.length, first_leg)
    _put_distractors(
        world,
        distractors,
        first_box,
        first_cylinder,
        used.boxes,
        stream,
        0.5 * width + p.wall_thickness,
        outer_length,
        -side,
        height,
        slots,
    )
    put_start(
        world,
        p,
        stream,
        slots,
        start_out,
        start_joints_out,
    )
    bend_out[world] = scenario - 1
    scenario_out[world] = scenario
    difficulty_out[world] = difficulty
    num_obstacles_out[world] = used.obstacles
