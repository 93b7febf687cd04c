"""What the failure analysis calls things and places, and how narrow they are."""

import numpy as np
import pytest

from spin_rl.analysis.failures.names import (
    HITS,
    base_velocity,
    kind_of,
    manner_of,
    motion_of,
    place_of,
)
from spin_rl.analysis.failures.width import free_width
from spin_rl.analysis.hits import FLOOR
from spin_rl.scenes.layout import PoolSpec, Scene


@pytest.mark.parametrize(
    ("driven", "turned", "expected"),
    [(4.0, 3.0, "drove"), (4.0, -7.0, "circled"), (0.1, 7.0, "spun"), (0.1, -6.0, "stood")],
)
def test_manners(driven, turned, expected):
    assert manner_of(driven, turned, 10.0) == expected


@pytest.mark.parametrize(
    ("forward", "turn", "expected"),
    [(0.3, 0.0, "forward"), (-0.08, 1.0, "backward"), (0.01, -0.5, "turning"), (-0.01, 0.05, "still")],
)
def test_motion(forward, turn, expected):
    assert motion_of(forward, turn) == expected
    for yaw in (0.0, 2.0):
        qvel = np.array([forward * np.cos(yaw), forward * np.sin(yaw), turn])
        assert base_velocity(np.array([5.0, 6.0, yaw]), qvel) == pytest.approx((forward, turn))


def test_kinds_and_places_of_generated_corridors(nav_env):
    nav_env.set_cells([1, 1, 1, 1, 2, 2, 2, 2], [0, 1, 2, 2, 0, 1, 2, 2])
    nav_env.reset()
    found = set()
    for scene in nav_env.sim.layout.scenes():
        kinds = {int(slot): kind_of(scene, slot) for slot in np.flatnonzero(scene.active)}
        assert sum(kind in HITS.values() for kind in kinds.values()) == scene.num_obstacles
        assert "distractor" in kinds.values()
        found |= set(kinds.values())
        half_width = abs(scene.pos[1, 1]) - scene.half_size[1, 1]
        for slot, kind in kinds.items():
            place = place_of(scene, scene.pos[slot, :2])
            if kind in HITS.values():
                assert place != "in corner" and (place == "straight") == (scene.bend == 0)
            if kind == "distractor":
                assert abs(scene.pos[slot, 1]) > half_width
        if scene.bend:
            assert place_of(scene, scene.goal) == "behind corner"
            assert place_of(scene, np.array([scene.goal[0], 0.0])) == "in corner"
            assert place_of(scene, scene.start) == "before corner"
    assert {"low", "head-height", "wall", "distractor"} <= found
    assert kind_of(scene, FLOOR) == "floor"


def scene_of_things(*things) -> Scene:
    """A wall, boxes and a cylinder of (x, y), half sizes along them, bottom and top [m]; in no corridor."""
    scene = Scene.empty(PoolSpec(1, 3, 1))
    scene.scenario = 0
    for slot, (x, y, half_x, half_y, bottom, top) in enumerate(things):
        scene.pos[slot], scene.active[slot] = (x, y, 0.5 * (bottom + top)), True
        scene.half_size[slot] = half_x, half_y, 0.5 * (top - bottom)
    return scene


def test_kinds_in_other_scenes():
    wide = 0.1, 0.1
    scene = scene_of_things(
        (3, 0, *wide, 0, 2), (2, 0, *wide, 0, 0.2), (1, 0, *wide, 0, 1.0), (0, 1, *wide, 1.1, 1.3),
        (0, 2, *wide, 0.5, 0.7),
    )  # fmt: skip
    scene.num_obstacles, scene.motion_speed[2] = 1, 0.5  # one piece of furniture is several boxes
    assert [kind_of(scene, slot) for slot in range(5)] == [
        "wall",
        "low",
        "mover",
        "head-height",
        "arm-height",
    ]
    assert kind_of(scene, FLOOR) == "floor" and place_of(scene, np.zeros(2)) is None


LEFT, RIGHT = (0.2, 0.3, 0.15, 0.15, 0.0, 0.5), (0.2, -0.3, 0.15, 0.15, 0.0, 0.5)


@pytest.mark.parametrize(
    ("things", "base", "slot", "expected"),
    [
        # A corridor along x, 0.6 m wide, and one obstacle in it: the nearest or the one that was hit.
        (((0, 0.4, 5, 0.1, 0, 1), (0, -0.4, 5, 0.1, 0, 1)), (1.0, 0.05), 0, 0.6),
        (((0, 0.4, 5, 0.1, 0, 1), (0, -0.4, 5, 0.1, 0, 1)), (1.0, -0.2), None, 0.6),
        # The front in a gap of 0.3 m, whose corners are 0.05 m ahead.
        ((LEFT, RIGHT), (0.0, 0.0), 0, 2 * np.hypot(0.05, 0.15)),
        # A corner clipped in passing, a wall 2 m away or none, or something above the robot.
        ((LEFT, (0, -2.1, 5, 0.1, 0, 1)), (0.0, 0.0), 0, np.hypot(0.05, 0.15) + 2.0),
        ((LEFT,), (0.0, 0.0), 0, None),
        ((LEFT, (0.2, -0.3, 0.15, 0.15, 1.5, 1.7)), (0.0, 0.0), 0, None),
        ((), (0.0, 0.0), None, None),
    ],
)
def test_the_free_width_of_a_place(things, base, slot, expected):
    width = free_width(scene_of_things(*things), np.array(base), slot)
    assert width is None if expected is None else width == pytest.approx(expected, abs=0.01)
