"""Parts of the classical stack against formulas and scikit-fmm, and the whole of it in a small place."""

from dataclasses import replace

import numpy as np
import pytest
import skfmm
from scipy.ndimage import distance_transform_edt
from stack_worlds import MODEL, PILLARS, ROOM, Place, exact_ranges

from spin_rl import robot
from spin_rl.baselines.lidar_stack import localization, mapping
from spin_rl.baselines.lidar_stack.follower import Follower
from spin_rl.baselines.lidar_stack.grids import Grids, Ways
from spin_rl.baselines.lidar_stack.policy import LidarStack, by_map_alone
from spin_rl.baselines.lidar_stack.poses import compose, relative
from spin_rl.baselines.lidar_stack.recovery import BACKING, CLEARING, DRIVING, ROTATING, Recovery
from spin_rl.baselines.lidar_stack.scans import LastTurn
from spin_rl.baselines.lidar_stack.settings import (
    FollowerSettings,
    LocalizationSettings,
    MapSettings,
    PlannerSettings,
    RecoverySettings,
)
from spin_rl.sensors.odometry import OdometryConfig
from spin_rl.warp_kernels.distance_field.field import UNREACHABLE
from spin_rl.warp_kernels.grid_map.scans import HIT, PASSED, SKIPPED

NUM_WORLDS = 2
EVERYWHERE = np.ones(NUM_WORLDS, dtype=bool)
GOAL = np.array([[4.0, 0.5]] * NUM_WORLDS)
SMALL = MapSettings(side_m=10.0)


@pytest.fixture(scope="module")
def mapped():
    """Grids after a mapping drive, the ways in them, and how far the last pose was off."""
    grids = Grids(NUM_WORLDS, SMALL)
    ways = Ways(grids, PlannerSettings())
    drive = mapping.MappingDrive(grids, ways, MODEL, SMALL, OdometryConfig())
    errors = drive.run(EVERYWHERE, Place(), GOAL, np.random.default_rng(1))
    return grids, ways, errors


def centres(grids):
    """Cell centres in the map, shape (ny, nx, 2)."""
    side = grids.shape[1]
    at = (np.arange(side) + 0.5) * grids.frame.cell
    return grids.frame.origin.numpy()[0] + np.stack(np.meshgrid(at, at), axis=-1)


def surface_distance(points):
    """Distance of points to walls and pillars [m], below 0 outside of the room and inside of pillars."""
    low, high = np.array(ROOM[:2]), np.array(ROOM[2:])
    walls = np.minimum(points - low, high - points).min(axis=-1)
    pillars = [np.hypot(*np.moveaxis(points - (x, y), -1, 0)) - radius for x, y, radius in PILLARS]
    return np.minimum(walls, np.min(pillars, axis=0))


def test_poses_compose_and_come_apart():
    rng = np.random.default_rng(0)
    frame, pose = rng.normal(size=(2, 50, 3))
    np.testing.assert_allclose(relative(frame, compose(frame, pose)), pose, atol=1e-12)
    np.testing.assert_allclose(compose(np.array([1.0, 2.0, 0.5 * np.pi]), np.array([1.0, 0.0, 0.1])),
                               (1.0, 3.0, 0.5 * np.pi + 0.1))  # fmt: skip


def test_drawn_motions_scatter_as_the_odometry_errs():
    motion, cfg = np.array([[0.5, 0.0, 0.0], [0.0, 0.0, 1.0]]), OdometryConfig()
    drawn = mapping.with_errors(motion, cfg, np.random.default_rng(0), (20000,))
    turn_by_turn, _, turn_by_way, way_by_way = cfg.variances()
    assert drawn[0, :, 0].std() == pytest.approx(np.sqrt(0.5 * way_by_way), rel=0.03)
    assert drawn[0, :, 2].std() == pytest.approx(np.sqrt(0.5 * turn_by_way), rel=0.03)
    assert drawn[1, :, 2].std() == pytest.approx(np.sqrt(turn_by_turn), rel=0.03)
    np.testing.assert_allclose(drawn.mean(axis=1), motion, atol=2e-3)


def test_the_map_shows_the_place(mapped):
    grids, _, errors = mapped
    assert (errors < 0.06).all()
    distance = surface_distance(centres(grids))
    for world in range(NUM_WORLDS):
        odds = grids.odds.numpy()[world]
        assert (np.abs(distance[odds > 0.0]) < 0.12).all()  # a cell's diagonal, and the map's own error
        assert (odds[distance > 0.15] < 0.0).mean() > 0.97  # seen to be free; the rest was hidden
        assert (odds > 0.0).sum() > 250  # 20 m of walls and 4 m of pillars in cells of 5 cm, seen in part


def test_ways_in_the_map_are_those_of_fast_marching(mapped):
    grids, ways, _ = mapped
    ways.plan(EVERYWHERE, GOAL)
    points, length = ways.lookahead(EVERYWHERE, np.zeros((NUM_WORLDS, 3)), 0.3)
    assert (np.hypot(*points.T) < 0.36).all() and (4.0 < length).all() and (length < 4.8).all()
    odds, values = grids.odds.numpy()[0], ways.field.values.numpy()[0]
    cells = centres(grids)
    away = distance_transform_edt(odds <= 0.0) * SMALL.cell_m
    goal_distance = np.linalg.norm(cells - GOAL[0], axis=-1)
    slowness = np.where((away <= PlannerSettings().near_m) | (odds == 0.0), 4.0, 1.0)
    blocked = away <= PlannerSettings().blocked_m
    start = np.ma.MaskedArray(goal_distance - PlannerSettings().goal_m, blocked)
    theirs = PlannerSettings().goal_m + skfmm.travel_time(start, 1.0 / slowness, dx=SMALL.cell_m, order=1)
    compared = ~np.ma.getmaskarray(theirs) & (odds != 0.0) & (goal_distance > 0.5)
    assert compared.sum() > 2000
    error = np.abs(values - theirs.filled(np.nan))[compared] / theirs.filled(np.nan)[compared]
    assert np.median(error) < 0.02 and np.quantile(error, 0.99) < 0.1


def test_no_way_leads_through_a_closed_door(mapped):
    _, ways, _ = mapped
    beyond = np.array([[7.0, 0.0]] * NUM_WORLDS)
    ways.plan(EVERYWHERE, beyond)
    _, length = ways.lookahead(EVERYWHERE, np.zeros((NUM_WORLDS, 3)), 0.3)
    assert (length >= UNREACHABLE).all()


def test_localization_converges_and_follows(mapped):
    grids, _, _ = mapped
    cfg = LocalizationSettings()
    filtered, place = localization.ParticleFilter(grids, cfg, np.random.default_rng(2)), Place()
    grids.finish_map(EVERYWHERE, cfg)
    filtered.restart(EVERYWHERE)
    # Much farther off than it is told to be.
    filtered.poses += (0.15, -0.15, 0.1)
    rng, true, told = np.random.default_rng(3), np.zeros((NUM_WORLDS, 3)), np.zeros((NUM_WORLDS, 3))
    errors = []
    for step in range(60):
        motion = np.array([[0.06, 0.0, 0.02 * np.sin(0.2 * step)]] * NUM_WORLDS) * (step >= 10)
        true = compose(true, motion)
        told = compose(told, mapping.with_errors(motion, OdometryConfig(0.4, 0.4, 0.4, 0.4), rng))
        ranges = place.scan(true, EVERYWHERE)
        counts = np.full(NUM_WORLDS, 360)
        filtered.update(EVERYWHERE, told, MODEL.points(ranges), counts)
        errors.append(np.abs(filtered.pose(told) - true))
    assert np.max(errors[8:], axis=(0, 1))[:2].max() < 0.15
    assert np.mean(errors[8:], axis=(0, 1))[:2].max() < 0.06 and np.mean(errors[8:], axis=(0, 1))[2] < 0.03
    assert filtered.poses.std(axis=1)[:, :2].max() < 0.1


def test_what_was_too_near_to_be_seen_again_is_kept():
    turn = LastTurn(MODEL, 1)
    ranges = np.full((1, 360), 3.0)
    ranges[0, 0] = 0.2
    turn.add(ranges, np.zeros((1, 3)))
    ranges[0, :2] = 0.0  # nothing comes back from ahead: once too near, once too far away
    turn.add(ranges, np.zeros((1, 3)))
    points, counts = turn.hits(np.zeros((1, 3)), 5.0)
    assert counts[0] == 359 and np.isclose(points[0, :359], (0.204, 0.0)).all(axis=-1).sum() == 1


def test_beams_mark_and_clear_only_so_far():
    ranges = np.array([[0.0, -1.0, 1.0, 2.8, 5.0] + [0.0] * 355])
    ends, kinds = MODEL.limited(ranges, 2.5, 3.0)
    assert kinds[0, :2].tolist() == [int(SKIPPED)] * 2 and kinds[0, 2] == int(HIT)
    lengths = np.linalg.norm(ends - MODEL.position, axis=-1)[0]
    np.testing.assert_allclose(lengths[2:5], (1.0, 2.8, 3.0))


def test_by_the_map_alone_nothing_is_marked_and_all_else_is_as_before():
    usual, by_map = LidarStack("cpu").settings, by_map_alone("cpu").settings
    ranges = np.array([[0.2, 1.0, 2.8] + [5.0] * 357])
    kinds = MODEL.limited(ranges, by_map.planner.mark_m, by_map.planner.clear_m)[1]
    assert (kinds == int(PASSED)).all()
    assert replace(by_map, planner=replace(by_map.planner, mark_m=usual.planner.mark_m)) == usual


def box_points(x, y, half, spacing=0.02):
    """The outline of a square obstacle, shape (n, 2)."""
    side = np.arange(-half, half + 1e-9, spacing)
    edges = [np.stack((side, np.full_like(side, s * half)), 1) for s in (-1, 1)]
    return np.concatenate([*edges, *(edge[:, ::-1] for edge in edges)]) + (x, y)


def free_ways(goal):
    """Ways over an empty, known floor."""
    grids = Grids(1, SMALL)
    grids.odds.numpy()[:] = -1.0
    grids.frame.origin.numpy()[:] = -5.0
    ways = Ways(grids, PlannerSettings())
    ways.plan(np.ones(1, dtype=bool), np.array([goal]))
    return ways


@pytest.mark.parametrize(
    ("obstacles", "check"),
    [
        ([], lambda v, w: v > 0.4 and abs(w) < 0.2),
        ([(0.7, 0.0, 0.2)], lambda v, w: v < 0.3 or abs(w) > 0.1),  # not straight into it
        ([(0.22, 0.0, 0.1)], lambda v, w: v <= 0.0),
    ],
)
def test_the_follower_drives_ahead_and_around(obstacles, check):
    follower = Follower(FollowerSettings(), robot.SPEED_PROFILES["paper"])
    points = np.concatenate([np.zeros((0, 2)), *(box_points(*one) for one in obstacles)])
    counts = np.array([len(points)])
    padded = np.concatenate([points, np.zeros((1, 2))])[None]
    now, ways = np.array([[0.6, 0.0]]), free_ways((3.0, 0.0))
    speeds = follower.choose(np.zeros((1, 3)), ways.field, padded, counts, now, np.array([False]))[0]
    assert check(*speeds), speeds
    # By brute force: no outline point comes into the footprint on the way that was chosen.
    low_x, low_y, high_x, high_y = FollowerSettings().footprint
    pose = np.zeros(3)
    for _ in range(120):
        pose = compose(pose, np.array([0.01 * speeds[0], 0.0, 0.01 * speeds[1]]))
        local = relative(pose, np.concatenate((points, np.zeros((len(points), 1))), axis=1))
        beyond = np.maximum((low_x, low_y) - local[:, :2], local[:, :2] - (high_x, high_y))
        assert (beyond.max(axis=1) > 0.0).all()


def test_who_gets_no_nearer_forgets_turns_and_backs_up():
    recovery = Recovery(1, RecoverySettings(), 0.1, np.random.default_rng(0))
    no = np.zeros(1, dtype=bool)
    modes = []
    for _ in range(130):
        recovery.watch(np.array([3.0]), no)
        modes.append(int(recovery.mode[0]))
    order = [mode for before, mode in zip([None, *modes], modes, strict=False) if mode != before]
    assert order[:4] == [DRIVING, CLEARING, ROTATING, BACKING]
    assert (modes.count(ROTATING), modes.count(BACKING)) == (40, 20)
    driving = Recovery(1, RecoverySettings(), 0.1, np.random.default_rng(0))
    for step in range(200):
        assert not driving.watch(np.array([10.0 - 0.04 * step]), no).any()
    assert driving.mode[0] == DRIVING


def test_the_exact_ranges_of_these_tests():
    # From the middle of the room: walls at 1, 5, 2, 2 m but for the lidar's own place, a pillar to the right.
    ranges = exact_ranges(np.zeros((1, 3)), np.array([[0.0, -1.0, 0.25]]))[0]
    assert ranges[[0, 90, 180]] == pytest.approx((4.996, 2.0, 1.004))
    assert ranges[270] == pytest.approx(0.75, abs=1e-3)
