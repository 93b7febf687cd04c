"""What the camera does with its actions: a rate, or nothing after some time; and one that shows nothing."""

import numpy as np
import pytest
import torch
import warp as wp

from spin_rl import robot
from spin_rl.tasks.common.compose import compose
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.spec import NAV

PAN, TILT = (robot.DOF_NAMES.index(joint) for joint in robot.CAMERA_JOINTS)
PERIOD = 0.1


def drive(env, pan, tilt, steps):
    """Give the same camera actions for some steps; returns the targets [rad], shape (steps, n, 2)."""
    action = torch.zeros(env.num_envs, 10, device=env.device)
    action[:, -2], action[:, -1] = pan, tilt
    targets = []
    for _ in range(steps):
        env.step(action)
        targets.append(wp.to_torch(env.sim.target)[:, -2:].clone())
    return torch.stack(targets).cpu().numpy()


def start_pose(env):
    return env.sim.views.qpos[:, [PAN, TILT]].cpu().numpy().copy()


def test_a_rate_moves_the_head_by_its_largest_speed_times_the_action(make_nav_env):
    env = make_nav_env(NavConfig(camera_action="rate", stop_on_collision=False), num_envs=4)
    start = start_pose(env)
    targets = drive(env, -0.1, 0.05, 3)
    fastest = np.array(robot.SPEED_PROFILES["paper"].joint_velocity_max[-2:])
    for step in range(3):
        moved = (step + 1) * PERIOD * fastest * (-0.1, 0.05)
        assert targets[step] == pytest.approx(start + moved, abs=1e-4)
    # Through the stowed pose, where the scale of actions changes, and up to the limits and no further.
    targets = drive(env, 1.0, -1.0, 12)
    assert targets[-1] == pytest.approx(np.tile([1.5, -1.53], (4, 1)), abs=1e-5)
    assert drive(env, 0.0, 0.0, 2)[-1] == pytest.approx(np.tile([1.5, -1.53], (4, 1)), abs=1e-5)


def test_a_frozen_camera_stays_where_it_was_sent_last_until_the_episode_ends(make_nav_env):
    env = make_nav_env(
        NavConfig(camera_frozen_after_s=0.3, stop_on_collision=False, episode_s=1.0), num_envs=4
    )
    first = drive(env, -0.5, 0.0, 2)
    last = drive(env, 0.4, -0.5, 1)
    assert first[-1, 0] == pytest.approx([-0.5 * 3.9, -0.6], abs=1e-5)
    assert last[-1, 0] == pytest.approx([0.4 * 1.5, -0.6 - 0.5 * 0.93], abs=1e-5)
    frozen = drive(env, 1.0, 1.0, 6)
    assert frozen == pytest.approx(np.broadcast_to(last[-1], frozen.shape), abs=1e-6)
    drive(env, 1.0, 1.0, 1)  # the tenth step is the last one
    assert drive(env, 1.0, 1.0, 1)[0] == pytest.approx(np.tile([1.5, 0.79], (4, 1)), abs=1e-5)


def test_the_shortest_time_lets_the_first_action_count(make_nav_env):
    env = make_nav_env(NavConfig(camera_frozen_after_s=0.01, stop_on_collision=False), num_envs=2)
    assert drive(env, 0.5, 0.0, 1)[0, :, 0] == pytest.approx([0.75, 0.75])
    assert drive(env, -0.5, 0.0, 2)[-1, :, 0] == pytest.approx([0.75, 0.75])


def test_a_held_pose_goes_before_both(make_nav_env):
    cfg = NavConfig(camera_pose=(-1.0, -0.2), camera_action="rate", camera_frozen_after_s=0.2)
    assert drive(make_nav_env(cfg, num_envs=2), 1.0, 1.0, 4)[-1] == pytest.approx(
        np.tile([-1.0, -0.2], (2, 1))
    )


def test_the_blind_control_is_shown_no_obstacle_and_its_critic_all(make_nav_env):
    cfg = NAV.configure(compose("train", ["camera=blind"]))
    obs = make_nav_env(cfg).get_observations()
    assert not obs["scandots"].any() and obs["scandots_all"].any()
    assert cfg.camera_pose is None


@pytest.mark.parametrize(
    ("change", "key"),
    [("camera_action=both", "task.camera_action"), ("camera_frozen_after_s=0", "task.camera_frozen_after_s")],
)
def test_what_cannot_be_meant_names_the_key(change, key):
    with pytest.raises(ValueError, match=key):
        NAV.configure(compose("train", [f"task.{change}"]))
