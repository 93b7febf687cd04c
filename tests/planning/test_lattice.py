"""The planner against scenes with known answers, and its paths against MuJoCo's collision detection."""

import mujoco
import numpy as np
import pytest

from spin_rl import robot
from spin_rl.planning.collision import blocked_poses
from spin_rl.planning.lattice import GOAL_TOLERANCE_M, HEADINGS_RAD, find_path, reachable
from spin_rl.planning.solvability import CELLS, generate_scenes, is_solvable
from spin_rl.scenes.builder import native_model
from spin_rl.scenes.layout import PoolSpec, Scene


def corridor(*boxes) -> Scene:
    """A corridor 1 m wide along x with boxes given as (x, y, z) ranges; start at 0, goal at 3 m."""
    walls = [
        ((-1.1, 4.1), (0.5, 0.6), (0, 1.5)),
        ((-1.1, 4.1), (-0.6, -0.5), (0, 1.5)),
        ((-1.1, -1.0), (-0.5, 0.5), (0, 1.5)),
        ((4.0, 4.1), (-0.5, 0.5), (0, 1.5)),
    ]
    scene = Scene.empty(PoolSpec(4, max(len(boxes), 1), 0))
    for slot, ranges in enumerate([*walls, *boxes]):
        low, high = np.array(ranges, dtype=float).T
        scene.pos[slot], scene.half_size[slot] = 0.5 * (low + high), 0.5 * (high - low)
        scene.active[slot] = True
    scene.goal[:] = (3.0, 0.0)
    return scene


def test_an_empty_corridor_has_a_way_to_the_goal():
    path = find_path(corridor())
    assert path is not None
    assert path.poses[0, :2] == pytest.approx([0.0, 0.0])
    assert np.hypot(*(path.poses[-1, :2] - (3.0, 0.0))) <= GOAL_TOLERANCE_M


@pytest.mark.parametrize(
    ("goal", "resolution"), [((3.0, 0.05), 0.04), ((0.05, -3.0), 0.04), ((3.0, 0.05), 0.08)]
)
def test_on_an_open_floor_start_and_goal_may_be_nearly_aligned(goal, resolution):
    scene = Scene.empty(PoolSpec())
    scene.goal[:] = goal
    path = find_path(scene)
    assert path is not None and np.hypot(*(path.poses[-1, :2] - goal)) <= GOAL_TOLERANCE_M
    assert reachable(scene, scene.goal[None], resolution).all()


@pytest.mark.parametrize(
    "box",
    [
        ((1.5, 1.7), (-0.5, 0.5), (0.0, 0.1)),  # a sill across the floor
        ((1.5, 1.7), (-0.5, 0.5), (1.25, 1.4)),  # a bar at head height
        ((1.5, 1.7), (-0.5, 0.5), (0.6, 0.7)),  # a bar that the mast cannot pass
        ((1.5, 1.7), (-0.5, 0.17), (0.0, 0.1)),  # 0.33 m left, less than the base
    ],
)
def test_blocked_corridors_have_none(box):
    assert find_path(corridor(box)) is None


@pytest.mark.parametrize(
    "box",
    [
        ((1.5, 1.7), (-0.5, 0.5), (1.45, 1.6)),  # above the head
        ((1.5, 1.7), (-0.5, 0.02), (0.0, 0.1)),  # 0.48 m left
        ((1.5, 1.7), (-0.02, 0.5), (0.0, 0.1)),
    ],
)
def test_passable_corridors_have_one(box):
    assert find_path(corridor(box)) is not None


def test_the_arm_is_lifted_over_what_the_base_passes_under():
    path = find_path(corridor(((1.5, 1.7), (-0.5, 0.2), (0.5, 0.66))))
    assert path is not None and path.lift == 0.9


def test_the_way_around_a_corner_of_boxes_needs_room_to_swing():
    left, right = ((1.5, 1.7), (0.0, 0.5), (0.0, 0.2)), ((1.8, 2.0), (-0.5, 0.0), (0.0, 0.2))
    assert find_path(corridor(left, right)) is None
    far = ((2.8, 3.0), (-0.5, 0.0), (0.0, 0.2))
    scene = corridor(left, far)
    scene.goal[:] = (3.5, 0.0)
    assert find_path(scene) is not None


def test_blocked_poses_are_those_where_mujoco_finds_contact():
    """Random poses near a yawed box and a cylinder: contact is never missed, clear poses are free."""
    scene = Scene.empty(PoolSpec(0, 1, 1))
    scene.pos[:] = [(0.0, 0.0, 0.5), (1.0, 0.0, 0.1)]
    scene.half_size[:] = [(0.2, 0.1, 0.5), (0.12, 0.12, 0.1)]
    scene.yaw[:] = (0.6, 0.0)
    scene.active[:] = True
    model = native_model(scene)
    data = mujoco.MjData(model)
    x, y = np.linspace(-0.7, 1.7, 25), np.linspace(-0.7, 0.7, 15)
    blocked = blocked_poses(scene, x, y, HEADINGS_RAD, robot.STOWED["lift"])
    rng = np.random.default_rng(0)
    touching = 0
    for _ in range(1500):
        heading, row, column = rng.integers(len(HEADINGS_RAD)), rng.integers(len(y)), rng.integers(len(x))
        data.qpos[:] = robot.qpos_from_joints(model, dict(robot.STOWED))
        data.qpos[:3] = (x[column], y[row], HEADINGS_RAD[heading])
        mujoco.mj_forward(model, data)
        if data.ncon:
            touching += 1
            assert blocked[heading, row, column]
        elif blocked[heading, row, column]:
            # Only what lies close: bounding boxes of capsules and the planner's margin.
            own = [
                g
                for g in range(model.ngeom)
                if model.geom_bodyid[g] and model.geom_contype[g] + model.geom_conaffinity[g]
            ]
            scene_geoms = [model.geom("box_0").id, model.geom("cylinder_0").id]
            distances = [
                mujoco.mj_geomDistance(model, data, a, b, 0.2, None) for a in own for b in scene_geoms
            ]
            assert min(distances) < 0.08
    assert touching > 200


@pytest.mark.parametrize(("scenario", "difficulty"), CELLS)
def test_generated_paths_can_be_driven_without_contact(scenario, difficulty):
    """Every pose on a found path, with steps of about 1 cm and 3 degrees between the lattice points."""
    scene = generate_scenes(1, scenario, difficulty, seed=21)[0]
    path = find_path(scene)
    assert path is not None
    model = native_model(scene)
    data = mujoco.MjData(model)
    stowed = robot.qpos_from_joints(model, {**robot.STOWED, "lift": path.lift})
    for a, b in zip(path.poses[:-1], path.poses[1:], strict=True):
        turn = np.angle(np.exp(1j * (b[2] - a[2])))
        for f in np.linspace(0.0, 1.0, 12):
            data.qpos[:] = stowed
            data.qpos[:3] = (*(a[:2] + f * (b[:2] - a[:2])), a[2] + f * turn)
            mujoco.mj_kinematics(model, data)
            mujoco.mj_collision(model, data)
            assert data.ncon == 0


@pytest.mark.slow
@pytest.mark.parametrize(("scenario", "difficulty"), CELLS)
def test_generated_layouts_are_solvable(scenario, difficulty):
    """A sample of what ``python -m spin_rl.planning.solvability`` measures on thousands."""
    scenes = generate_scenes(25, scenario, difficulty, seed=3)
    assert all(is_solvable(scene) for scene in scenes)


@pytest.mark.slow
def test_wide_training_corridors_are_solvable():
    assert all(is_solvable(scene) for scene in generate_scenes(10, 0, 2, seed=4, level=0.0))
