"""A camera that goes to poses in turn."""

from itertools import pairwise

import pytest
import torch

from spin_rl import robot
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.tasks.nav.config import NavConfig

POSES = ((0.0, -0.1), (-1.2, -1.3), (0.5, -0.7))
PERIOD_STEPS = 40


def head_positions(make_nav_env, poses=POSES, **settings):
    """Head pan and tilt of every step, and what the gaze says, shape (steps, 2) and (steps, num_envs, 3)."""
    scene = Scene.empty(PoolSpec())
    scene.start_joints[:] = [robot.STOWED[joint] for joint in robot.JOINTS]
    scene.goal[:] = (4.0, 0.0)
    env = make_nav_env(NavConfig(gaze_poses=poses, **settings), num_envs=2, scene=scene)
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
    taught, said = head_positions(make_nav_env, teach_gaze=True)
    assert len(said) == PERIOD_STEPS and taught.equal(went)  # as while a policy learns it


def test_poses_may_lie_close_to_each_other(make_nav_env):
    poses = ((0.0, -0.1), (0.0, -0.35))
    went, _ = head_positions(make_nav_env, poses, camera_action="gaze")
    assert len(visits(went, poses)) >= 6


@pytest.mark.parametrize(
    ("held", "wanted"),
    [(POSES[1], POSES[2]), (POSES[2], POSES[0]), ((-0.6, -0.7), POSES[0]), ((-0.9, -1.2), POSES[1])],
)
def test_a_head_that_does_not_obey_is_sent_to_the_pose_after_its_own_or_to_the_first(
    make_nav_env, held, wanted
):
    """So what is said follows from where the head is and where it was sent: from what the policy is told."""
    _, said = head_positions(make_nav_env, teach_gaze=True, camera_pose=held)
    action = [robot.action_of(joint, at) for joint, at in zip(robot.CAMERA_JOINTS, wanted, strict=True)]
    for step in said[5:]:
        assert step[0].tolist() == pytest.approx([*action, 1.0]) and step[0].equal(step[1])


@pytest.mark.parametrize(
    ("poses", "message"),
    [
        (((0.0, -0.1), (0.0, 2.0)), r"task\.gaze_poses: 2\.0 is outside the limits of head_tilt"),
        (((0.0, -0.1), (0.0, -0.7), (0.0, -0.1)), r"task\.gaze_poses: a pose stands twice"),
    ],
)
def test_poses_that_cannot_be_taken_in_turn_are_named(poses, message):
    with pytest.raises(ValueError, match=message):
        NavConfig(gaze_poses=poses)
