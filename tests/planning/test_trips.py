"""Random trips: they start clear of everything, have a way, and depend on the seed alone."""

import mujoco
import numpy as np
import pytest

from spin_rl import robot
from spin_rl.paths import CONF_DIR
from spin_rl.planning import trips
from spin_rl.planning.lattice import reachable
from spin_rl.scenes.builder import native_model
from spin_rl.scenes.corridors.params import GeneratorParams
from spin_rl.scenes.scene_file import load_scene, parse_scene

PARAMS = GeneratorParams()


@pytest.fixture(scope="module")
def scene():
    return load_scene(CONF_DIR / "scenes_examples" / "playroom.yaml")


@pytest.fixture(scope="module")
def drawn(scene):
    return trips.draw_trips(scene, 6, PARAMS, seed=1)


def test_starts_and_goals_can_be_reached_and_lie_apart(scene, drawn):
    ends = np.array([end for trip in drawn for end in (trip.start[:2], trip.goal)])
    assert reachable(scene, ends, 0.08).all()
    assert min(np.linalg.norm(trip.goal - trip.start[:2]) for trip in drawn) >= trips.SHORTEST_M
    assert len(np.unique(ends[::2], axis=0)) == len(drawn)


def test_the_robot_touches_nothing_at_a_start(drawn):
    for trip in drawn:
        model = native_model(trip)
        data = mujoco.MjData(model)
        data.qpos[:] = robot.qpos_from_joints(model, dict(zip(robot.JOINTS, trip.start_joints, strict=True)))
        data.qpos[:3] = trip.start
        mujoco.mj_forward(model, data)
        slots = [model.geom(name).id for name in trip.pool.geom_names()]
        assert not np.isin(data.contact.geom, slots).any()
    assert len({tuple(trip.start_joints) for trip in drawn}) == len(drawn)


def test_the_same_seed_gives_the_same_trips(scene, drawn):
    again, other = (trips.draw_trips(scene, 6, PARAMS, seed=seed) for seed in (1, 2))
    for name in ("start", "start_joints", "goal"):
        first, second, third = ([getattr(trip, name) for trip in group] for group in (drawn, again, other))
        np.testing.assert_array_equal(first, second)
        assert not np.array_equal(first, third)


def test_poses_keep_the_margin():
    """A wall beside the base, nearer and farther than the margin; the base is 0.363 m wide."""
    base = {"start": {"position": [0, 0]}, "goal": [0, 3]}
    for gap, clear in ((trips.MARGIN_M - 0.01, False), (trips.MARGIN_M + 0.02, True)):
        wall = {"position": [-0.1, -(0.187 + gap + 0.05)], "size": [1.0, 0.1, 1.5]}
        here = trips._Robot(parse_scene(base | {"walls": [wall]}))
        assert here.is_clear(np.zeros(3), trips._STOWED) is clear


BOX = [
    {"position": [x, y], "size": [sx, sy, 1.5]}
    for x, y, sx, sy in ((0, 0.6, 1.3, 0.1), (0, -0.6, 1.3, 0.1), (0.6, 0, 0.1, 1.3), (-0.6, 0, 0.1, 1.3))
]


def test_a_goal_behind_walls_has_no_way_and_a_closet_no_trips():
    closet = {"start": {"position": [0, 0]}, "goal": [2, 0], "walls": BOX}
    assert not trips.has_way(parse_scene(closet))
    assert trips.has_way(parse_scene(closet | {"walls": BOX[:2]}))
    with pytest.raises(ValueError, match=r"^scene: "):
        trips.draw_trips(parse_scene(closet), 2, PARAMS, seed=0)


def test_an_empty_floor_has_trips():
    floor = parse_scene({"start": {"position": [0, 0]}, "goal": [3, 3]})
    (trip,) = trips.draw_trips(floor, 1, PARAMS, seed=0)
    assert np.linalg.norm(trip.goal - trip.start[:2]) >= trips.SHORTEST_M
