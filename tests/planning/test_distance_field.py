"""Distance fields against scikit-fmm, formulas, and the lattice planner, which shares no code with them."""

import numpy as np
import pytest
import skfmm
import warp as wp
from field_worlds import POOL, ROOM, centres, distance, layout_of, reachable, read, scattered, scene_of, solve

from spin_rl.planning.distance_field import BASE_HALF_WIDTH_M, CLEARANCE_M, DistanceField, GridSpec
from spin_rl.planning.lattice import find_path
from spin_rl.planning.solvability import CELLS, generate_scenes
from spin_rl.scenes.layout import Layout, Scene
from spin_rl.warp_kernels.distance_field.field import UNREACHABLE


def test_the_empty_world_has_straight_distances(device):
    rng = np.random.default_rng(0)
    goals = [(0.0, 0.0), (3.21, -4.07), (-5.6, 5.6)]
    fields = solve([scene_of(goal=goal) for goal in goals], device)
    points = rng.uniform(-5.8, 5.8, (3, 5000, 2))
    straight = np.linalg.norm(points - np.array(goals)[:, None], axis=-1)
    error = read(fields, points) - straight
    assert error.min() > -1e-4
    assert (error / straight).max() < 0.03 and (error / straight).mean() < 0.015
    near = straight < 0.5
    assert near.sum() > 20 and np.abs(error[near]).max() < 1e-4


@pytest.mark.parametrize("cell", [0.1, 0.15])
def test_values_agree_with_scikit_fmm(device, cell):
    """Both are first-order on the same cells, and start from a circle of exact values in the open."""
    grid = GridSpec.square(7.0, cell)
    scenes = [scattered(seed) for seed in range(6)]
    values = solve(scenes, device, grid).field.values.numpy()
    points = centres(grid)
    frame = np.ones(points.shape[:2], dtype=bool)
    frame[1:-1, 1:-1] = False
    for scene, mine in zip(scenes, values, strict=True):
        away = distance(scene, points)
        straight = np.linalg.norm(points - scene.goal, axis=-1)
        circle, passable = 5.5 * cell, (away >= grid.blocked_m) & ~frame
        speed = np.where(away < CLEARANCE_M, 0.25, 1.0)
        phi = np.ma.MaskedArray(straight - circle, mask=~passable)
        theirs = circle + np.ma.filled(skfmm.travel_time(phi, speed, dx=cell, order=1), np.inf)
        theirs[straight < circle] = straight[straight < circle]
        reached = passable & np.isfinite(theirs)
        assert reached.sum() > 300
        np.testing.assert_array_equal(mine[passable] < UNREACHABLE, reached[passable])
        np.testing.assert_allclose(mine[reached], theirs[reached], rtol=2e-3, atol=0.25 * cell)
        np.testing.assert_array_equal(mine[(away <= 0.0) | frame], UNREACHABLE)


def walls_with_a_gap(rng, width) -> Scene:
    """A wall through the whole grid, turned and shifted at random, with a gap."""
    yaw, offset = rng.uniform(-np.pi, np.pi), rng.uniform(-0.3, 0.3, 2)
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    half = rng.choice([0.001, 0.05, 0.3])
    sides = [turn @ (0.0, side * (5.0 + 0.5 * width)) + offset for side in (-1, 1)]
    return scene_of(
        *[(*side, half, 5.0, yaw) for side in sides],
        start=turn @ (-1.5, 0.4) + offset,
        goal=turn @ (1.5, -0.7) + offset,
    )


@pytest.mark.parametrize("cell", [0.05, 0.1, 0.15])
@pytest.mark.parametrize(("width", "is_open"), [(0.0, False), (0.01 + 2 * BASE_HALF_WIDTH_M, True)])
def test_gaps_are_open_wherever_the_cells_lie(device, cell, width, is_open):
    rng = np.random.default_rng(0)
    scenes = [walls_with_a_gap(rng, width) for _ in range(100)]
    assert (reachable(scenes, device, GridSpec.square(5.0, cell)) == is_open).all()


def test_gaps_narrower_than_twice_the_blocked_distance_are_closed(device):
    rng = np.random.default_rng(1)
    scenes = [walls_with_a_gap(rng, 2.0 * ROOM.blocked_m - 0.001) for _ in range(100)]
    assert not reachable(scenes, device, ROOM).any()


@pytest.mark.parametrize(("bottom", "is_open"), [(0.0, False), (1.4, False), (1.45, True), (1.6, True)])
def test_what_hangs_above_the_robot_does_not_count(device, bottom, is_open):
    assert reachable([scene_of((0.0, 0.0, 0.1, 6.0, 0.0, bottom))], device).item() == is_open


def test_a_goal_inside_an_obstacle_or_outside_the_grid_is_unreachable(device):
    inside = scene_of((2.0, 0.0, 0.3, 0.3))
    assert not reachable([inside, scene_of(goal=(5.95, 0.0)), scene_of(goal=(40.0, 0.0))], device).any()


def test_a_goal_at_a_wall_is_reached_from_its_own_side(device):
    """The base's point may be 6 cm from a wall, nearer than ways come."""
    fields = solve([scene_of((2.07, 0.0, 0.01, 3.5))], device, ROOM)
    here, behind = read(fields, [(1.0, 0.0), (2.3, 0.0)])
    assert 1.0 <= here < 1.1 and behind > UNREACHABLE


def test_values_at_a_thin_wall_are_those_of_the_own_side(device):
    """0.07 m before a wall of 2 cm, around which the way is long."""
    fields = solve([scene_of((0.0, 1.0, 0.01, 4.0), goal=(0.5, 0.0))], device, ROOM)
    y = np.linspace(-1.0, 1.0, 41)
    before, beyond = (read(fields, np.stack([np.full(41, x), y], axis=1)) for x in (-0.08, 0.08))
    own = read(fields, np.stack([np.full(41, -0.5), y], axis=1))
    assert (beyond < 1.8).all() and (before > own).all() and (own > 5.0).all()


def test_values_change_little_over_short_moves(device):
    scenes = [scene_of(goal=(1.0, 0.3)), *(scattered(seed) for seed in range(4))]
    fields = solve(scenes, device, ROOM)
    rng = np.random.default_rng(2)
    points = rng.uniform(-3.3, 3.3, (5, 20000, 2))
    moved = points + rng.uniform(-0.02, 0.02, points.shape)
    length = np.maximum(np.linalg.norm(moved - points, axis=-1), 1e-3)
    slope = np.abs(read(fields, moved) - read(fields, points)) / length
    assert slope[0].max() < 1.08
    for scene, where, slopes in zip(scenes[1:], points[1:], slope[1:], strict=True):
        free = distance(scene, where) > CLEARANCE_M + 2.0 * ROOM.cell_m
        inside = (np.abs(where) < 2.9).all(axis=-1) & free
        assert inside.sum() > 500
        # Behind corners two bounds of the differences, one along each axis, add up.
        assert slopes[inside].max() < 1.5 and np.quantile(slopes[inside], 0.98) < 1.1


def test_outside_the_grid_values_go_on(device):
    fields = solve([scene_of()], device, ROOM)
    points = np.array([(3.4, 0.0), (3.5, 0.1), (9.0, 0.0), (-9.0, 2.0), (0.0, 50.0)])
    np.testing.assert_allclose(read(fields, points), np.hypot(*(points - (2.0, 0.0)).T), rtol=0.03)
    assert np.isnan(read(fields, [(np.nan, 0.0)])).all()


def test_a_way_around_a_wall_has_the_length_of_the_taut_string(device):
    top = 0.5
    fields = solve([scene_of((0.0, top - 5.0, 1e-3, 5.0))], device)
    tangent = np.sqrt(4.0 + top**2 - CLEARANCE_M**2)
    arc = 2.0 * (np.pi - np.arccos(CLEARANCE_M / np.hypot(2.0, top)) - np.arctan2(2.0, top))
    assert fields.path_length.numpy()[0] == pytest.approx(2.0 * tangent + CLEARANCE_M * arc, rel=0.03)


def test_ways_lead_from_start_to_goal_past_the_obstacles(device):
    scenes = [scattered(seed) for seed in range(8)]
    fields = solve(scenes, device, ROOM)
    lengths = fields.path_length.numpy()
    for world, scene in enumerate(scenes):
        path = fields.path(world)
        if lengths[world] >= UNREACHABLE:
            assert len(path) == 0
            continue
        np.testing.assert_allclose(path[[0, -1]], [scene.start[:2], scene.goal], atol=1e-5)
        steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
        assert steps.sum() == pytest.approx(lengths[world], rel=1e-4)
        assert distance(scene, path.astype(float)).min() > ROOM.blocked_m - 0.5 * ROOM.cell_m
        assert np.hypot(*(scene.start[:2] - scene.goal)) <= lengths[world] + 1e-4
    assert 2 <= (lengths < UNREACHABLE).sum() <= 7


def test_worlds_are_independent_and_masked_ones_stay(device):
    scenes = [scattered(0), scene_of(), scattered(1)]
    alone = [solve([scene], device, ROOM) for scene in scenes]
    together = solve(scenes, device, ROOM)
    values = together.field.values.numpy().copy()
    for world, single in enumerate(alone):
        np.testing.assert_array_equal(values[world], single.field.values.numpy()[0])
        np.testing.assert_array_equal(together.path(world), single.path(0))
    goal = wp.array([(0.0, 0.0), (1.0, 1.0), (2.0, 2.0)], dtype=wp.vec2, device=device)
    together.update(goal, wp.array([False, True, False], dtype=bool, device=device))
    after = together.field.values.numpy()
    np.testing.assert_array_equal(after[[0, 2]], values[[0, 2]])
    assert (after[1] != values[1]).any()
    np.testing.assert_allclose(
        together.field.goal.numpy(), [scenes[0].goal, (1.0, 1.0), scenes[2].goal], rtol=1e-6
    )


def test_the_origin_may_differ_between_worlds(device):
    layout = layout_of([scene_of(goal=(0.0, 0.0)), scene_of(goal=(50.0, 20.0))], device)
    fields = DistanceField(layout, device, ROOM)
    fields.field.origin.assign(np.array([(-3.5, -3.5), (46.5, 16.5)], dtype=np.float32))
    fields.update(layout.goal, wp.full(2, True, dtype=bool, device=device))
    np.testing.assert_allclose(*fields.field.values.numpy(), atol=1e-3)


def test_graph_replay_equals_eager(device):
    scenes = [scattered(seed) for seed in range(3)]
    layout = layout_of(scenes, device)
    fields = DistanceField(layout, device, ROOM)
    mask = wp.full(3, True, dtype=bool, device=device)

    def launch():
        fields.update(layout.goal, mask)
        fields.trace(layout.start, mask)

    launch()
    eager = [array.numpy().copy() for array in (fields.field.values, fields.path_length)]
    with wp.ScopedCapture(device=device) as capture:
        launch()
    for array in (fields.field.values, fields.path_length):
        array.fill_(-1.0)
    wp.capture_launch(capture.graph)
    for array, values in zip((fields.field.values, fields.path_length), eager, strict=True):
        np.testing.assert_array_equal(array.numpy(), values)


def test_agrees_with_the_lattice_planner_on_random_rooms(device):
    """A way that the planner finds is open here; one with room to turn in is found by the planner."""
    scenes = [scattered(seed, count=38 - 2 * seed) for seed in range(10)]
    planned = np.array([find_path(scene) is not None for scene in scenes])
    is_open = reachable(scenes, device, ROOM)
    is_wide = reachable(scenes, device, ROOM, blocked_m=0.35)
    assert not (planned & ~is_open).any() and not (is_wide & ~planned).any()
    assert planned.any() and not is_open.all() and is_wide.any()


@pytest.mark.parametrize(("scenario", "difficulty"), CELLS)
def test_generated_corridors_are_open(device, scenario, difficulty):
    """The planner finds ways in all of them."""
    scenes = generate_scenes(100, scenario, difficulty, seed=5)
    assert reachable(scenes, device, GridSpec.around(scenes)).all()


LAYOUT = Layout(1, POOL, "cpu")


def test_a_grid_around_scenes_holds_them_in_bounded_cells():
    scene = scene_of((0.0, 0.0, 30.0, 0.1, 0.5), goal=(4.0, -31.0))
    grid = GridSpec.around([scene, scene_of()], max_cells=10_000)
    points = centres(grid)[1:-1, 1:-1].reshape(-1, 2)
    c, s = np.cos(0.5), np.sin(0.5)
    reach = np.array([30.0 * c + 0.1 * s, 30.0 * s + 0.1 * c])
    assert (points.min(axis=0) <= np.minimum(-reach, (-2.0, -31.0))).all()
    assert (points.max(axis=0) >= np.maximum(reach, (4.0, 0.0))).all()
    assert 0.1 < grid.cell_m and 9_000 < grid.nx * grid.ny < 11_000
    assert GridSpec.around([scene_of()]).cell_m == 0.1


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: GridSpec(nx=3), "nx 3"),
        (lambda: GridSpec(cell_m=0.0), "cell_m"),
        (lambda: DistanceField(LAYOUT, "cpu", GridSpec(cell_m=0.01)), "cell_m must be at least"),
        (lambda: DistanceField(LAYOUT, "cpu", blocked_m=0.1), "blocked_m"),
    ],
)
def test_impossible_grids_are_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()
