"""A camera that goes to poses in turn."""

from itertools import pairwise

import pytest
import torch

from spin_rl import robot
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.tasks.nav.config import NavConfig

POSES = ((0.0, -0.1), (-1.2, -1.3), (0.5, -0.7))
PERIOD_STEPS = 40


def head_positions(make_nav_env, **settings):
    """Head pan and tilt of every step, and what the gaze says, shape (steps, 2) and (steps, num_envs, 3)."""
    scene = Scene.empty(PoolSpec())
    scene.start_joints[:] = [robot.STOWED[joint] for joint in robot.JOINTS]
    scene.goal[:] = (4.0, 0.0)
    env = make_nav_env(NavConfig(gaze_poses=POSES, **settings), num_envs=2, scene=scene)
    head = [robot.DOF_NAMES.index(joint) for joint in robot.CAMERA_JOINTS]
    went, said = [], []
    for _ in range(PERIOD_STEPS):
        obs = env.step(torch.zeros(2, 10, device=env.device))[0]
        went.append(env.sim.views.qpos[0, head].cpu())
        if "gaze" in obs:
            said.append(obs["gaze"].cpu())
    return torch.stack(went), said


def visits(went, poses=POSES):
    """Numbers of the poses that the head was near to, in the order of its visits."""
    near = [
        number
        for at in went
        for number, pose in enumerate(poses)
        if (at - torch.tensor(pose)).abs().max() < 0.12
    ]
    return [number for i, number in enumerate(near) if i == 0 or near[i - 1] != number]


def test_the_head_goes_to_all_poses_in_turn(make_nav_env):
    went, said = head_positions(make_nav_env, camera_action="gaze")
    order = visits(went)
    assert not said and len(order) >= 6
    assert all(after == (before + 1) % 3 for before, after in pairwise(order))


def test_what_it_says_is_where_to_go_until_the_head_is_there(make_nav_env):
    went, said = head_positions(make_nav_env, teach_gaze=True, camera_pose=(-1.2, -1.3))
    assert visits(went) == [1]  # the head is held at the second pose, and so never arrives at the third
    first = [robot.action_of(joint, at) for joint, at in zip(robot.CAMERA_JOINTS, POSES[0], strict=True)]
    for step in said:
        assert step[:, 2].tolist() == [1.0, 1.0]
        assert step[0, :2].tolist() == pytest.approx(first)  # where it goes first, and never gets


def test_a_pose_out_of_reach_is_named():
    with pytest.raises(ValueError, match=r"task\.gaze_poses: 2\.0 is outside the limits of head_tilt"):
        NavConfig(gaze_poses=((0.0, -0.1), (0.0, 2.0)))
