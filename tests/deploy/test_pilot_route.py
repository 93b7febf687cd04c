"""The pilot's ways beside those of scikit-fmm, and where they lead."""

from dataclasses import replace

import numpy as np
import pytest

from spin_rl.deploy.pilot.costmap import Costmap
from spin_rl.deploy.pilot.field import UNREACHABLE
from spin_rl.deploy.pilot.route import Route
from spin_rl.deploy.pilot.settings import Planner

SETTINGS = Planner(True, 2.0, 0.5, 1.5, clearance_m=0.25, blocked_m=0.16, cell_m=0.12, size_m=12.0)
START, GOAL = np.array([-2.0, 0.0]), np.array([2.0, 0.0])


class Told(Costmap):
    """A map whose boxes are given, x, y, half x, half y."""

    def __init__(self, *boxes):
        super().__init__(np.full(2, -6.0), 12.0, 0.06, memory_s=10.0, period_s=0.1)
        self.told = np.reshape(np.array(boxes, dtype=float), (-1, 4))
        self.changed = True

    def boxes(self):
        return self.told[:, :2], self.told[:, 2:]


def planned(*boxes, start=START, goal=GOAL, settings=SETTINGS):
    """A route that has planned once, where the robot is at the start."""
    route, costmap = Route(settings, start, goal, 0.1), Told(*boxes)
    for _ in range(60):
        route.update(costmap, start)
    assert not costmap.changed
    return route


def distance(boxes, points):
    """Distance of points (..., 2) to the nearest box."""
    gaps = [
        np.linalg.norm(np.maximum(np.abs(points - box[:2]) - box[2:], 0.0), axis=-1)
        for box in np.array(boxes)
    ]
    return np.min(gaps, axis=0)


def centres(field):
    rows, columns = field.values.shape
    at = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1)
    return field.origin + field.cell * (at + 0.5)


def scattered(seed):
    """Boxes all over the place, none near the goal."""
    rng = np.random.default_rng(seed)
    boxes = np.column_stack([rng.uniform(-5.0, 5.0, (60, 2)), rng.uniform(0.02, 0.5, (60, 2))])
    far = np.maximum(np.abs(boxes[:, :2] - GOAL) - boxes[:, 2:], 0.0)
    return boxes[np.linalg.norm(far, axis=-1) > 0.25 + 6.5 * SETTINGS.cell_m]


@pytest.mark.parametrize("seed", range(4))
def test_values_agree_with_scikit_fmm(seed):
    skfmm = pytest.importorskip("skfmm")
    boxes = scattered(seed)
    # From the far corner, so that all ways are asked for.
    route = planned(*boxes, start=np.array([-5.5, -5.5]))
    field = route.field
    points, mine = centres(field), field.values
    away, straight = distance(boxes, points), np.linalg.norm(points - field.goal, axis=-1)
    frame = np.ones(mine.shape, dtype=bool)
    frame[1:-1, 1:-1] = False
    passable, circle = (away >= SETTINGS.blocked_m) & ~frame, 5.5 * field.cell
    speed = np.where(away < SETTINGS.clearance_m, 0.25, 1.0)
    phi = np.ma.MaskedArray(straight - circle, mask=~passable)
    theirs = circle + np.ma.filled(skfmm.travel_time(phi, speed, dx=field.cell, order=1), np.inf)
    theirs[straight < circle] = straight[straight < circle]
    here = field.at(np.array([[-5.5, -5.5]]))[0]
    reached = passable & (theirs < min(here, 99.0))
    assert reached.sum() > 2000
    np.testing.assert_allclose(mine[reached], theirs[reached], rtol=2e-3, atol=0.25 * field.cell)
    np.testing.assert_array_equal(mine[(away <= 0.0) | frame], UNREACHABLE)


def test_the_empty_map_has_straight_distances():
    field = planned().field
    points = np.random.default_rng(0).uniform(-4.0, 4.0, (500, 2))
    straight = np.linalg.norm(points - GOAL, axis=-1)
    known = straight < 4.0
    error = field.at(points) - straight
    assert error.min() > -1e-4 and (error / straight)[known].max() < 0.03


def test_the_point_ahead_is_on_the_way_around_a_wall():
    wall = (0.0, 1.0, 0.05, 3.0)  # from y = -2 to 4
    route = planned(wall)
    at = route.subgoal(START)
    assert 1.7 < np.linalg.norm(at - START) < 2.05 and at[1] < -1.2
    place, route = START, planned(wall, settings=replace(SETTINGS, ahead_m=0.3))
    for _ in range(200):
        step = route.subgoal(place) - place
        place = place + 0.05 * step / max(np.linalg.norm(step), 0.05)
        assert distance([wall], place[None])[0] > SETTINGS.blocked_m - 0.03
    np.testing.assert_allclose(place, GOAL, atol=0.1)


def test_a_goal_near_or_unreachable_is_told_itself():
    np.testing.assert_array_equal(planned().subgoal(np.array([0.5, 0.0])), GOAL)
    around = [(2.0, 0.6, 0.7, 0.05), (2.0, -0.6, 0.7, 0.05), (2.6, 0.0, 0.05, 0.7), (1.4, 0.0, 0.05, 0.7)]
    closed = planned(*around)
    assert closed.field.at(START[None])[0] >= UNREACHABLE
    np.testing.assert_array_equal(closed.subgoal(START), GOAL)
    np.testing.assert_array_equal(planned(goal=np.array([30.0, 0.0])).subgoal(START), (30.0, 0.0))


def test_a_goal_beside_a_thin_wall_is_reached_from_its_own_side():
    wall = [(2.07, y, 0.01, 0.03) for y in np.arange(-3.5, 3.5, 0.06)]
    field = planned(*wall).field
    here, behind = field.at(np.array([[1.0, 0.0], [2.3, 0.0]]))
    assert 1.0 <= here < 1.15 and behind > 4.0


@pytest.mark.parametrize(("gap", "is_open"), [(0.30, False), (0.56, True)])
def test_gaps_are_as_wide_as_asked_for(gap, is_open):
    sides = [(0.0, side * (3.5 + 0.5 * gap), 0.03, 3.5) for side in (-1, 1)]
    assert (planned(*sides).field.at(START[None])[0] < 6.0) == is_open


def test_plans_are_made_for_news_and_not_too_often():
    route, costmap = Route(SETTINGS, START, GOAL, 0.1), Told((0.0, 0.0, 0.1, 1.0))
    before, plans = route.field, []
    for tick in range(30):
        costmap.changed |= tick in (0, 6, 20)
        route.update(costmap, START)
        if route.field is not before:
            plans.append(tick)
            before = route.field
    assert len(plans) == 3 and np.diff(plans).min() >= 5
