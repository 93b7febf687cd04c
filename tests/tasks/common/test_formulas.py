"""What policies are told, from plain tensors as a robot has them; the judge is C MuJoCo or NumPy."""

import math

import mujoco
import numpy as np
import pytest
import torch

from spin_rl import robot
from spin_rl.tasks.common import formulas

COUNT = 16


def tensor(values):
    return torch.tensor(np.asarray(values), dtype=torch.float32)


@pytest.fixture
def rng():
    return np.random.default_rng(4)


def rotations(rng):
    """Random orientations, shape (COUNT, 3, 3)."""
    frames = np.zeros((COUNT, 9))
    for frame, quat in zip(frames, rng.normal(size=(COUNT, 4)), strict=True):
        mujoco.mju_quat2Mat(frame, quat / np.linalg.norm(quat))
    return frames.reshape(COUNT, 3, 3)


def base_frames(base):
    """Rotation and position of base poses, shape (COUNT, 3, 3) and (COUNT, 3)."""
    c, s, zero = np.cos(base[:, 2]), np.sin(base[:, 2]), np.zeros(len(base))
    frames = np.stack([c, -s, zero, s, c, zero, zero, zero, zero + 1], -1).reshape(-1, 3, 3)
    return frames, np.column_stack([base[:, :2], zero])


def test_joints_are_scaled_by_their_limits():
    lower, upper = np.array(robot.JOINT_LOWER), np.array(robot.JOINT_UPPER)
    for share, wanted in ((0.0, -1.0), (0.25, -0.5), (1.0, 1.0)):
        at = formulas.joint_position(tensor(lower + share * (upper - lower))[None])
        np.testing.assert_allclose(at, np.full((1, 8), wanted), atol=1e-6)
    fastest = robot.SPEED_PROFILES["paper"].joint_velocity_max
    np.testing.assert_allclose(formulas.joint_velocity(-0.5 * tensor(fastest)[None]), -0.5 * np.ones((1, 8)))


def test_proprio_has_its_blocks_in_order():
    blocks = [torch.full((2, width), float(i)) for i, width in enumerate((8, 8, 2, 3, 10))]
    wanted = [i for i, width in enumerate((8, 8, 2, 3, 10)) for _ in range(width)]
    assert formulas.proprio(*blocks).tolist() == [wanted] * 2


def test_points_goals_hands_and_objects_are_those_of_a_numpy_formula(rng):
    base = rng.uniform(-3.0, 3.0, (COUNT, 3))
    frames, origins = base_frames(base)
    points, centres = rng.uniform(-2.0, 2.0, (2, COUNT, 3))
    centres = points + rng.uniform(-0.3, 0.3, (COUNT, 3))
    grippers, grip = rotations(rng), rng.uniform(-0.5, 0.5, (COUNT, 1))
    point_b = np.einsum("nji,nj->ni", frames, points - origins)
    np.testing.assert_allclose(formulas.in_base(tensor(points), tensor(base)), point_b, atol=1e-5)

    goal_b = formulas.in_base(tensor(points[:, :2]), tensor(base))
    distance = np.hypot(*(points - origins)[:, :2].T)
    wanted = np.column_stack([point_b[:, :2], distance]) / 2.5
    np.testing.assert_allclose(formulas.goal(goal_b), wanted, atol=1e-5)

    gripper_b = np.einsum("nji,njk->nik", frames, grippers)
    wanted = np.column_stack([gripper_b[:, :, 0], gripper_b[:, :, 2], grip])
    np.testing.assert_allclose(formulas.hand(*map(tensor, (grippers, base, grip))), wanted, atol=1e-5)

    offset = np.einsum("nji,nj->ni", grippers, points - centres)
    clipped = [np.clip(offset / unit, -1.0, 1.0) for unit in (0.2, 0.05)]
    wanted = np.column_stack([np.ones(COUNT), point_b, *clipped])
    told = formulas.seen_object(*map(tensor, (points, base, centres, grippers)))
    np.testing.assert_allclose(told, wanted, atol=2e-5)


@pytest.mark.parametrize("farthest", [0.5, 5.0])
def test_far_goals_are_told_as_less_far_in_their_direction(farthest):
    distance = np.array([0.0, 0.4, 4.9, 5.1, 40.0])
    direction = np.array([math.cos(2.0), math.sin(2.0)])
    shown = np.minimum(distance, farthest)
    wanted = np.column_stack([shown[:, None] * direction, shown]) / 2.5
    told = formulas.goal(tensor(distance[:, None] * direction), farthest)
    np.testing.assert_allclose(told, wanted, atol=1e-6)


def test_what_is_measured_in_the_base_frame_needs_no_pose(rng):
    """The same is told of a hand and an object in the frame of odometry and in that of the base."""
    base = rng.uniform(-3.0, 3.0, (COUNT, 3))
    frames, origins = base_frames(base)
    point_b, centre_b = rng.uniform(-0.2, 0.2, (2, COUNT, 3))
    gripper_b = rotations(rng)
    point, centre = (np.einsum("nij,nj->ni", frames, p) + origins for p in (point_b, centre_b))
    gripper, here, grip = frames @ gripper_b, np.zeros((COUNT, 3)), np.zeros((COUNT, 1))
    pairs = [
        (formulas.seen_object, (point, base, centre, gripper), (point_b, here, centre_b, gripper_b)),
        (formulas.hand, (gripper, base, grip), (gripper_b, here, grip)),
        (formulas.in_base, (point, base), (point_b, here)),
    ]
    for formula, moved, still in pairs:
        told, wanted = formula(*map(tensor, moved)), formula(*map(tensor, still))
        np.testing.assert_allclose(told, wanted, atol=5e-5, err_msg=formula.__name__)
