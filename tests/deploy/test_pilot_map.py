"""What the pilot's map takes in of depth images, and what it lets go."""

import numpy as np
import pytest
from pilot_worlds import ROOM, camera_at, contract, distance_to, look, picture, stowed

from spin_rl.deploy.pilot.costmap import CEILING_M, LAYER_M, layers_between
from spin_rl.deploy.pilot.eye import Eye
from spin_rl.deploy.pilot.pilot import Pilot

BOX = ((1.0, -0.3, 0.0), (1.4, 0.3, 0.5))
START, GOAL = np.zeros(3), np.array([2.0, 0.0])


@pytest.fixture
def pilot():
    made = Pilot(contract())
    made.reset(START, GOAL)
    return made


def occupied(pilot):
    """Middles and layers of the occupied cells."""
    window = pilot.costmap.around(np.zeros(2), 20.0)
    taken = window.layers > 0
    return window.middle[taken], window.layers[taken]


def is_at_the_box(pilot):
    return (np.abs(occupied(pilot)[0] - (1.2, 0.0)) < 0.4).all(-1)


def test_points_are_where_the_boxes_are():
    eye, joints, base = Eye(contract().camera), stowed(0.3, -0.7), np.array([-1.2, 0.4, 0.8])
    camera = camera_at(joints, base)
    boxes = [*ROOM, BOX]
    points = camera.to_base(eye.points(picture(boxes, camera)))
    assert len(points) > 2000
    error = np.minimum(distance_to(boxes, points), np.abs(points[:, 2]))
    assert error.max() < 1e-4


def test_a_point_is_seen_through_only_where_all_around_it_is(pilot):
    eye, camera = Eye(contract().camera), camera_at(stowed(), START)
    image = picture([BOX], camera)
    front, before = np.array([[1.0, 0.0, 0.25]]), np.array([[0.8, 0.0, 0.25]])
    behind = np.array([[1.6, 0.0, 0.1]])
    told = [bool(eye.sees_through(points, image, camera)[0]) for points in (front, before, behind)]
    assert told == [False, True, False]
    beside = np.stack(np.meshgrid(1.0, np.linspace(0.301, 0.31, 10), np.linspace(0.15, 0.45, 10)), -1)
    for side in (1.0, -1.0):
        points = beside.reshape(-1, 3) * (1.0, side, 1.0)
        assert not eye.sees_through(points, image, camera).any()
        assert eye.sees_through(points * (1.0, 1.2, 1.0), image, camera).all()
    image[image > 0.0] = 0.0  # nothing measured, nothing known
    assert not eye.sees_through(before, image, camera)[0]


def test_an_empty_floor_is_no_obstacle(pilot):
    look(pilot, [], START, tilts=(0.0, -0.5, -1.4))
    assert len(occupied(pilot)[0]) == 0 and not pilot.costmap.changed


def test_cells_hold_what_was_seen_at_its_height(pilot):
    floating = ((1.0, -1.5, 0.8), (1.3, -1.1, 1.0))
    boxes = [*ROOM, BOX, floating]
    look(pilot, boxes, START)
    middle, layers = occupied(pilot)
    flat = [(low[:2], high[:2]) for low, high in boxes]
    assert len(middle) > 300
    inside = np.min([np.maximum(low - middle, middle - high).max(-1) for low, high in flat], axis=0)
    assert inside.max() < 0.03  # a box around points on two sides of a corner
    near = {
        name: (np.abs(middle - at) < 0.25).all(-1)
        for name, at in (("low", (1.2, 0.0)), ("high", (1.15, -1.3)))
    }
    assert near["low"].sum() > 15 and near["high"].sum() > 10
    assert (layers[near["low"]] & ~layers_between(0.0, 0.5 + LAYER_M) == 0).all()
    hides = 0.62  # down to there what the front hides behind it
    assert (layers[near["high"]] & ~layers_between(hides, 1.0 + LAYER_M) == 0).all()
    walls = np.abs(middle[:, 0] - 3.0) < 0.02
    tall = np.bitwise_or.reduce(layers[walls])
    assert tall >> 4 == layers_between(0.0, CEILING_M) >> 4


def test_a_wall_that_was_seen_above_stands_on_the_floor(pilot):
    """Level, the camera sees it from 0.4 m up; a shelf that it sees beneath hangs."""
    wall, shelf = ((0.95, -1.0, 0.0), (1.0, 1.0, 1.5)), ((1.8, -0.7, 1.0), (2.0, 0.7, 1.2))
    for box, standing in ((wall, layers_between(0.17, 1.4)), (shelf, 0)):
        pilot.reset(START, GOAL)
        look(pilot, [box], START, pans=(0.0,), tilts=(0.0,))
        layers = occupied(pilot)[1]
        assert (
            len(layers) > 10
            and (layers & layers_between(0.0, 0.8) == standing & layers_between(0.0, 0.8)).all()
        )


def test_edges_are_half_a_pixel_beyond_what_shows_them():
    eye, camera = Eye(contract().camera), camera_at(stowed(0.0, -0.6), START)
    pixel = 2.0 * np.tan(np.radians(29.0)) / 58
    rims, points = (camera.to_base(of(picture([BOX], camera))) for of in (eye.rims, eye.points))
    front = [some[(np.abs(some[:, 0] - 1.0) < 0.02) & (some[:, 2] > 0.03)] for some in (rims, points)]
    depth = 1.3
    for side in (-1.0, 1.0):
        shown, told = (max(side * some[:, 1]) for some in (front[1], front[0]))
        assert shown < 0.3 and told - shown == pytest.approx(0.5 * pixel * depth, abs=0.004)
        assert abs(told - 0.3) <= 0.5 * pixel * depth


@pytest.mark.parametrize(("pan", "tilt"), [(0.0, -0.3), (0.6, -0.8), (-0.5, 0.0)])
def test_a_plane_has_no_edges(pan, tilt):
    walls = [((-9.0, 0.5, 0.0), (90.0, 0.6, 30.0)), ((-9.0, -0.7, 0.0), (90.0, -0.5, 30.0))]
    eye, camera = Eye(contract().camera), camera_at(stowed(pan, tilt), START)
    rims = eye.rims(picture(walls, camera))
    assert len(rims) < 5, camera.to_base(rims)


def test_what_moves_away_is_gone_once_seen_through_and_what_stands_stays(pilot):
    look(pilot, [*ROOM, BOX], START)
    before = is_at_the_box(pilot)
    assert before.sum() > 20
    look(pilot, ROOM, START)
    assert not is_at_the_box(pilot).any()
    assert len(occupied(pilot)[0]) > 0.97 * (~before).sum()


def test_what_hides_behind_something_stays(pilot):
    """A screen is put before the box: it is not seen through."""
    screen = ((0.5, -1.0, 0.0), (0.55, 1.0, 2.0))
    look(pilot, [BOX], START)
    before = len(occupied(pilot)[0])
    look(pilot, [screen], START)
    assert is_at_the_box(pilot).sum() == before


@pytest.mark.parametrize(("seconds", "is_known"), [(90.0, True), (130.0, False)])
def test_what_was_not_seen_for_long_is_forgotten(seconds, is_known):
    told = contract()
    made = Pilot(told)
    made._guard = type(told.guard)(**{**vars(told.guard), "memory_s": 120.0})
    made.reset(START, GOAL)
    look(made, [BOX], START, pans=(0.0,))
    joints = stowed(-3.0)
    image = np.zeros((87, 58), dtype=np.float32)
    for _ in range(round(seconds * told.rate_hz)):
        made.see(image, joints, START)
    assert bool(len(occupied(made)[0])) == is_known


def test_what_came_to_where_the_floor_was_is_forgotten_sooner_unless_it_stays(pilot):
    joints, blind = stowed(), np.zeros((87, 58), dtype=np.float32)
    camera = camera_at(joints, START)

    def watch(boxes, steps):
        for _ in range(steps):
            pilot.see(picture(boxes, camera), joints, START)

    pilot._guard = type(pilot._guard)(**{**vars(pilot._guard), "memory_s": 120.0})
    for steps, is_known in ((3, False), (30, True)):
        pilot.reset(START, GOAL)
        watch([], 5)
        watch([BOX], steps)
        assert len(occupied(pilot)[0]) > 10
        for _ in range(130):
            pilot.see(blind, joints, START)
        assert (len(occupied(pilot)[0]) > 10) == is_known


@pytest.mark.parametrize("away", [(11.0, 0.0), (-7.3, 9.2), (0.0, -40.0)])
def test_the_map_goes_along(pilot, away):
    """What is around the robot is known wherever it drives, what is far behind is not."""

    def near(place):
        middle, _ = pilot.costmap.boxes()
        return middle[(np.abs(middle - place) < 2.05).all(-1)]

    look(pilot, ROOM, START)
    at_start = len(near((0.0, 0.0)))
    moved = [(np.add(low, (*away, 0.0)), np.add(high, (*away, 0.0))) for low, high in ROOM]
    look(pilot, moved, (*away, 0.0))
    here = near(away)
    assert len(here) > 0.95 * at_start > 100
    assert distance_to(moved, np.column_stack([here, np.ones(len(here))])).max() < 0.03
    assert (len(near((0.0, 0.0))) > 0) == (np.abs(away).max() < 15.0)


def test_what_is_near_stays_as_it_was_when_the_map_goes_along(pilot):
    look(pilot, [BOX], (6.0, 0.0, 3.14), pans=(0.0,), tilts=(-0.4,))
    far = ((6.9, -0.4, 0.0), (7.2, 0.4, 0.5))
    look(pilot, [far], (5.5, 0.0, 0.0), pans=(0.0,), tilts=(-0.4,))
    before = pilot.costmap.boxes()
    pilot.costmap.changed = False
    pilot.see(np.zeros((87, 58), dtype=np.float32), stowed(), np.array([7.5, 0.0, 0.0]))
    assert pilot.costmap.changed and len(before[0]) > 10
    for ours, theirs in zip(pilot.costmap.boxes(), before, strict=True):
        np.testing.assert_array_equal(ours, theirs)
