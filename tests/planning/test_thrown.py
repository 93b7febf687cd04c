"""Obstacles that are thrown into trips: where, and that a way remains by the planner that shares no code."""

from dataclasses import replace

import numpy as np
import pytest

from spin_rl.planning.thrown import Throw, throw_into
from spin_rl.planning.trips import has_way
from spin_rl.scenes.scene_file import parse_scene

CORRIDOR = {
    "start": {"position": [0, 0], "yaw": 0.3},
    "goal": [5, 0],
    "walls": [
        {"position": [2.5, 1.2], "size": [7, 0.1, 1]},
        {"position": [2.5, -1.2], "size": [7, 0.1, 1]},
    ],
}


@pytest.fixture(scope="module")
def thrown():
    return throw_into([parse_scene(CORRIDOR)] * 6, Throw(), count=6, seed=4)


def test_a_way_remains_past_what_lies_and_what_has_stepped_in(thrown):
    for static, dynamic in zip(thrown.static, thrown.dynamic, strict=True):
        assert has_way(static)
        there = dynamic.pos.copy()
        there[-1] = dynamic.home[-1]
        assert has_way(replace(dynamic, pos=there))


def test_one_more_moves_and_all_else_is_the_same(thrown):
    for static, dynamic in zip(thrown.static, thrown.dynamic, strict=True):
        assert static.active.sum() >= 2 + 3 and not static.moves and dynamic.moves
        assert dynamic.active.sum() == static.active.sum() + 1
        np.testing.assert_array_equal(static.pos[:-1], dynamic.pos[:-1])
        last, throw = -1, Throw()
        assert throw.trigger[0] <= dynamic.motion_trigger[last] <= throw.trigger[1]
        assert throw.way[0] <= np.linalg.norm(dynamic.retreat[last]) <= throw.way[1]
        # It steps onto the way: between start and goal, at most as far aside as the way is.
        assert 0.5 < dynamic.home[last, 0] < 4.5 and abs(dynamic.home[last, 1]) < 1.0
        for end in (dynamic.start[:2], dynamic.goal):
            assert np.linalg.norm(dynamic.home[last, :2] - end) > 0.55
    assert len({tuple(scene.pos[-2]) for scene in thrown.static}) == 6


def test_all_depends_on_the_seed_alone(thrown):
    again = throw_into([parse_scene(CORRIDOR)] * 6, Throw(), count=6, seed=4)
    for first, second in zip(thrown.dynamic, again.dynamic, strict=True):
        np.testing.assert_array_equal(first.pos, second.pos)


def test_a_place_without_room_is_refused():
    narrow = CORRIDOR | {
        "walls": [
            {"position": [2.5, 0.28], "size": [7, 0.1, 1]},
            {"position": [2.5, -0.28], "size": [7, 0.1, 1]},
        ]
    }
    with pytest.raises(ValueError, match=r"^scene: obstacles leave a way in 0 of 1 trips, 1 are needed"):
        throw_into([parse_scene(narrow)], Throw(aside=0.05), count=1, seed=0)
