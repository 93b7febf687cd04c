"""Distance fields that are solved for the ways from around one cell, against those of all cells."""

import numpy as np
import pytest
import warp as wp
from field_worlds import ROOM, centres, distance, layout_of, scattered, scene_of

from spin_rl.planning.distance_field import DistanceField
from spin_rl.warp_kernels.distance_field.field import UNREACHABLE

BEYOND_M = 1.5
SCENES = [scattered(seed) for seed in range(12)]


class Fields:
    """Fields of scenes towards cells, and of all cells."""

    def __init__(self, scenes, device):
        self.layout = layout_of(scenes, device)
        self.some = DistanceField(self.layout, device, ROOM, beyond_m=BEYOND_M)
        self.every = DistanceField(self.layout, device, ROOM)
        self.everywhere = wp.full(len(scenes), True, dtype=bool, device=device)

    def solve(self, near):
        """Return values of all cells, then of those around the cells (row, column), shape (n, 2)."""
        self.some.near.assign((near @ (ROOM.nx, 1)).astype(np.int32))
        for fields in (self.every, self.some):
            fields.update(self.layout.goal, self.everywhere)
        return self.every.field.values.numpy().copy(), self.some.field.values.numpy().copy()


def to_cell(point):
    return np.floor((np.asarray(point)[::-1] - ROOM.origin[1]) / ROOM.cell_m).astype(int)


def lengths_through(every, near):
    """Of the ways from cells (row, column) over any other to the goal, the first part straight."""
    grid = np.stack(np.indices(every.shape[1:]), -1)
    return every + ROOM.cell_m * np.linalg.norm(grid - near[:, None, None], axis=-1)


def own(values, near):
    return values[np.arange(len(values)), near[:, 0], near[:, 1]]


def test_the_ways_from_around_a_cell_are_known(device):
    near = np.array([to_cell(scene.start[:2]) for scene in SCENES])
    every, some = Fields(SCENES, device).solve(near)
    assert (own(every, near) < UNREACHABLE).sum() > 10
    # What is blocked gets its value from the side that is reached first.
    passable = np.array([distance(scene, centres(ROOM)) >= ROOM.blocked_m for scene in SCENES])
    needed = passable & (lengths_through(every, near) < own(every, near)[:, None, None] + BEYOND_M - 0.5)
    assert needed.sum() > 1000
    np.testing.assert_allclose(some[needed], every[needed], atol=0.02)
    assert (some > every - 0.02)[passable].all()
    far = lengths_through(every, near) > own(every, near)[:, None, None] + BEYOND_M + 2.5
    assert (some[far & (every < UNREACHABLE)] == UNREACHABLE).mean() > 0.5


def test_from_a_blocked_cell_the_ways_around_it_are_known(device):
    """The robot may be where no way leads."""
    near = []
    for scene in SCENES:
        away = distance(scene, centres(ROOM))
        blocked = np.argwhere((away > 0.0) & (away < ROOM.blocked_m))
        near.append(blocked[len(blocked) // 2])
    near = np.array(near)
    every, some = Fields(SCENES, device).solve(near)
    reached = own(every, near) < UNREACHABLE
    assert reached.sum() > 6
    np.testing.assert_allclose(own(some, near)[reached], own(every, near)[reached], atol=0.02)


def test_a_plan_leaves_nothing_behind_for_the_next(device):
    fields = Fields(SCENES, device)
    near = np.array([to_cell(scene.start[:2]) for scene in SCENES])
    before = fields.solve(near)[1]
    goals = fields.layout.goal.numpy().copy()
    fields.layout.goal.assign(-goals)
    assert (fields.solve(near)[1] != before).any()
    fields.layout.goal.assign(goals)
    np.testing.assert_array_equal(fields.solve(near)[1], before)


@pytest.mark.parametrize("goal", [(40.0, 0.0), (2.0, 0.0)])
def test_where_no_way_leads_none_is_found(device, goal):
    inside = scene_of((2.0, 0.0, 0.3, 0.3), goal=goal)
    _, some = Fields([inside], device).solve(np.array([[20, 20]]))
    assert (some == UNREACHABLE).all()
