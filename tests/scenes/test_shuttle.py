"""Corridors to drive through ahead and back: what they promise, and that there is a way."""

import mujoco
import numpy as np
import pytest
from room_worlds import generate, only

from spin_rl import robot
from spin_rl.config import ConfigError, from_mapping
from spin_rl.planning import solvability
from spin_rl.scenes.builder import native_model
from spin_rl.scenes.rooms.params import FamilyParams

PARAMS = only("shuttle")


@pytest.fixture(scope="module")
def scenes(device):
    return generate(200, device, PARAMS, seed=3).scenes()


def things(scene):
    return np.flatnonzero(scene.active & ~scene.is_wall)


def test_the_base_cannot_turn_round(scenes):
    """Its farthest corner is 0.34 m from the wheels' middle, the nearest corner on the other side 0.19 m."""
    for scene in scenes:
        width = 2.0 * (abs(scene.pos[0, 1]) - scene.half_size[0, 1])
        assert 0.53 - 1e-5 <= width <= 0.56 + 1e-5
        assert scene.half_size[:4, 2].min() >= 0.8  # the camera does not see above the walls


def test_things_leave_their_passage_and_are_hidden_before(scenes):
    low_sides, floating_sides = [], []
    for scene in scenes:
        half_width = abs(scene.pos[0, 1]) - scene.half_size[0, 1]
        assert len(things(scene)) == scene.num_obstacles >= 3
        for slot in things(scene):
            side = np.sign(scene.pos[slot, 1])
            face = side * scene.pos[slot, 1] - scene.half_size[slot, 1]
            floats = scene.pos[slot, 2] - scene.half_size[slot, 2] > 0.05
            assert half_width + face >= PARAMS.shuttle.passage - (0.021 if floats else 1e-4)
            assert (
                face + side * scene.retreat[slot, 1] >= half_width + 0.029 and scene.retreat[slot, 0] == 0.0
            )
            (floating_sides if floats else low_sides).append(side)
            bottom, top = scene.pos[slot, 2] + np.array((-1, 1)) * scene.half_size[slot, 2]
            assert (0.75 <= bottom < top <= 1.35 + 1e-5) if floats else top <= 0.25 + 1e-5
    share = len(floating_sides) / (len(floating_sides) + len(low_sides))
    assert share == pytest.approx(0.5, abs=0.08)
    # No side is safe, and none tells the kind.
    assert 0.4 < np.mean(np.array(low_sides + floating_sides) > 0.0) < 0.6
    assert 0.02 < np.mean(np.array(floating_sides) < 0.0) < 0.3


def test_nothing_comes_out_behind_before_the_robot_comes_back(scenes):
    for scene in scenes:
        x = scene.home[things(scene), 0]
        behind = x < 0.0
        assert behind.sum() >= 2 and (~behind).sum() >= 1
        away = np.hypot(x, scene.home[things(scene), 1] - scene.start[1])
        assert (away[behind] > scene.motion_trigger[things(scene)][behind]).all()
        assert (
            np.diff(np.sort(x)).min() >= 0.74 and x.max() <= scene.via[0] + 0.1 and x.min() >= scene.goal[0]
        )


def test_it_goes_ahead_and_then_back(scenes):
    for scene in scenes:
        assert scene.has_via and 1.2 <= scene.via[0] <= 1.5 and -2.9 <= scene.goal[0] <= -2.2
        assert scene.way_m == pytest.approx(2 * scene.via[0] - scene.goal[0], abs=1e-5)
        assert abs(scene.start[2]) <= 0.03 and scene.start[0] == 0.0
    assert len({round(float(scene.start_joints[0]), 4) for scene in scenes}) > 150


def test_the_start_is_clear_for_mujoco(scenes):
    for scene in scenes[:25]:
        slots = things(scene)
        scene.pos[slots, :2] += scene.retreat[slots]
        model = native_model(scene)
        data = mujoco.MjData(model)
        data.qpos[:] = robot.qpos_from_joints(model, dict(zip(robot.JOINTS, scene.start_joints, strict=True)))
        data.qpos[:3] = scene.start
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        assert data.ncon == 0
        scene.pos[slots] = scene.home[slots]


@pytest.mark.slow
def test_the_planner_finds_a_way_to_both_goals(scenes):
    """With everything out; 1000: python -m spin_rl.planning.solvability --scene shuttle."""
    solved = [solvability.is_solvable(scene) for scene in scenes]
    assert np.mean(solved) >= 0.995
    blocked = scenes[0]
    slot = things(blocked)[0]
    blocked.pos[slot, 1], blocked.half_size[slot, 1:] = 0.0, (0.3, 0.6)
    assert not solvability.is_solvable(blocked)


def test_other_families_have_one_goal(device):
    for scene in generate(8, device, only("crossing"), seed=1).scenes():
        assert not scene.has_via


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"passage": 0.3}, r"scene\.shuttle\.passage must be at least 0\.42"),
        ({"passage": 0.5}, r"scene\.shuttle\.passage must be .* and leave"),
        ({"width": [0.4, 0.5]}, r"scene\.shuttle\.width must be"),
        ({"floating_share": 2.0}, r"scene\.shuttle\.floating_share must be in"),
    ],
)
def test_impossible_shuttles_are_refused(changes, message):
    with pytest.raises(ConfigError, match=message):
        from_mapping(FamilyParams, {"shuttle": changes}, "scene")
