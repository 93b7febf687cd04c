"""Observation groups against NumPy formulas and MuJoCo's kinematics."""

import mujoco
import numpy as np
import pytest
import torch
from nav_worlds import actions, run

from spin_rl import robot
from spin_rl.scenes.layout import PoolSpec
from spin_rl.tasks.common.formulas import GOAL_SCALE_M
from spin_rl.tasks.common.proprioception import PROPRIO
from spin_rl.tasks.nav.config import NavConfig, NavNoise
from spin_rl.tasks.nav.spec import NAV_GROUPS

DOF = {name: i for i, name in enumerate(robot.DOF_NAMES)}


def blocks(proprio):
    """The named parts of the proprio group."""
    ends = np.cumsum(list(PROPRIO.values()))
    assert proprio.shape[1] == ends[-1]
    return dict(zip(PROPRIO, np.split(proprio.cpu().numpy(), ends[:-1], axis=1), strict=True))


def tokens(group):
    """Corners (n, slots, 8, 3) and flags (n, slots, 8) of a scandot group."""
    values = group.cpu().numpy().reshape(group.shape[0], -1, 32)
    return values[..., :24].reshape(*values.shape[:2], 8, 3), values[..., 24:]


def joints_of(values):
    """JOINTS values of generalized ones, shape (n, 8)."""
    found = {name: values[:, column] for name, column in DOF.items()}
    found["arm_extension"] = found["arm_outer"] + found["arm_inner"]
    found["gripper_finger"] = (found["finger_left"] + found["finger_right"]) / 2
    return np.stack([found[name] for name in robot.JOINTS], axis=1)


def to_base(vectors, yaw):
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack([c * vectors[:, 0] + s * vectors[:, 1], c * vectors[:, 1] - s * vectors[:, 0]], axis=1)


def test_groups_and_shapes(nav_env):
    obs = nav_env.get_observations()
    sizes = {"proprio": 31, "goal": 3, "scandots": PoolSpec().num_slots * 32}
    sizes["scandots_all"] = sizes["scandots"]
    assert tuple(obs.keys()) == NAV_GROUPS
    for name, size in sizes.items():
        assert obs[name].shape == (8, size) and obs[name].dtype == torch.float32, name


def test_proprio_and_goal(nav_env):
    last = actions(6, 8, forward=0.0) * 1.2
    run(nav_env, last)
    obs = nav_env.get_observations()
    qpos, qvel = nav_env.sim.data.qpos.numpy(), nav_env.sim.data.qvel.numpy()
    parts = blocks(obs["proprio"])
    lower, upper = np.array(robot.JOINT_LOWER), np.array(robot.JOINT_UPPER)
    np.testing.assert_allclose(
        parts["joint_position"], 2 * (joints_of(qpos) - lower) / (upper - lower) - 1, atol=1e-5
    )
    fastest = np.array(robot.SPEED_PROFILES["paper"].joint_velocity_max)
    np.testing.assert_allclose(parts["joint_velocity"], joints_of(qvel) / fastest, atol=1e-5)
    assert np.abs(parts["joint_velocity"]).max() > 0.2 and (np.abs(parts["joint_position"]) <= 1.001).all()

    yaw = qpos[:, 2]
    forward, sideways = to_base(qvel[:, :2], yaw).T
    np.testing.assert_allclose(parts["base_velocity"], np.stack([forward, qvel[:, 2]], axis=1), atol=1e-6)
    assert np.abs(sideways).max() < 0.1 * np.abs(forward).max()  # it drives where it looks
    running = nav_env.episode_length_buf.cpu().numpy() > 0
    assert running.sum() >= 4
    np.testing.assert_allclose(parts["last_action"][running], last[-1].clamp(-1, 1).numpy()[running])

    model = robot.load_spec().compile()
    data = mujoco.MjData(model)
    for world in range(nav_env.num_envs):
        data.qpos[:] = qpos[world]
        mujoco.mj_kinematics(model, data)
        at = data.site("link_grasp_center").xpos
        xy = to_base(at[None, :2] - qpos[world, :2], yaw[world : world + 1])[0]
        np.testing.assert_allclose(parts["end_effector"][world], [*xy, at[2]], atol=1e-5)

    goal = to_base(nav_env.goal.cpu().numpy() - qpos[:, :2], yaw)
    wanted = np.concatenate([goal, np.linalg.norm(goal, axis=1, keepdims=True)], axis=1) / GOAL_SCALE_M
    np.testing.assert_allclose(obs["goal"].cpu().numpy(), wanted, atol=1e-5)


def test_policy_sees_only_what_the_camera_does(nav_env):
    nav_env.set_cells([0] * 8, [2] * 8)
    nav_env.reset()
    run(nav_env, actions(3, 8))
    obs = nav_env.get_observations()
    seen, seen_flags = tokens(obs["scandots"])
    everything, flags = tokens(obs["scandots_all"])
    assert set(np.unique(seen_flags)) == set(np.unique(flags)) == {0.0, 1.0}
    assert (seen_flags <= flags).all()
    assert (seen[seen_flags == 0] == 0).all() and (everything[flags == 0] == 0).all()
    walls = PoolSpec().num_walls
    # A wall's token is the piece that is seen, within the piece that is near.
    is_seen = seen_flags[:, :walls, 0] == 1
    piece, near = seen[:, :walls][is_seen], everything[:, :walls][is_seen]
    assert len(piece) > 0
    assert (piece >= near.min(axis=1, keepdims=True) - 1e-4).all()
    assert (piece <= near.max(axis=1, keepdims=True) + 1e-4).all()
    seen, seen_flags = seen[:, walls:], seen_flags[:, walls:]
    everything, flags = everything[:, walls:], flags[:, walls:]
    assert 0 < seen_flags.sum() < flags.sum()
    np.testing.assert_array_equal(seen[seen_flags == 1], everything[seen_flags == 1])

    # Every seen corner of an obstacle is in the picture of MuJoCo's camera frame.
    tan_x, tan_y = robot.camera_tan_half_fov(nav_env.cfg.camera_mount)
    model = robot.load_spec().compile()
    data = mujoco.MjData(model)
    qpos = nav_env.sim.data.qpos.numpy()
    for world in range(nav_env.num_envs):
        data.qpos[:] = qpos[world]
        data.qpos[:3] = 0.0  # the corners are in the base frame
        mujoco.mj_kinematics(model, data)
        site = data.site("camera_depth_optical_frame")
        x, y, z = ((seen[world][seen_flags[world] == 1] - site.xpos) @ site.xmat.reshape(3, 3)).T
        assert (z >= nav_env.cfg.scandots.near_m - 1e-4).all()
        assert (np.abs(x) <= (tan_x + 1e-3) * z).all() and (np.abs(y) <= (tan_y + 1e-3) * z).all()


def test_turning_the_head_changes_what_is_seen_and_nothing_else(nav_env):
    before = nav_env.get_observations()
    pan = robot.ACTIONS.index("head_pan")
    held = nav_env.sim.views.action.clone()
    held[:, pan] = torch.where(held[:, pan] > 0, -1.0, 1.0)
    for _ in range(8):
        _, _, done, _ = nav_env.step(held)
        assert not done.any()
    after = nav_env.get_observations()
    flags = tokens(before["scandots"])[1], tokens(after["scandots"])[1]
    assert (flags[0] != flags[1]).any(axis=(1, 2)).sum() >= 6
    np.testing.assert_allclose(tokens(before["scandots_all"])[0], tokens(after["scandots_all"])[0], atol=2e-3)


def test_noise_moves_what_it_should(make_nav_env):
    noise = NavNoise(
        joint_position=0.01, joint_velocity=0.02, base_velocity=0.03, goal_m=0.04, scandots_m=0.05
    )
    num_envs = 64
    noisy, clean = make_nav_env(NavConfig(noise=noise), num_envs), make_nav_env(num_envs=num_envs)
    difference = {name: [] for name in NAV_GROUPS}
    for _ in range(8):
        a, b = noisy.get_observations(), clean.get_observations()
        for name in NAV_GROUPS:
            difference[name].append((a[name] - b[name]).cpu().numpy())
    stacked = {name: np.concatenate(values) for name, values in difference.items()}
    proprio = blocks(torch.tensor(stacked["proprio"]))
    for name, scale in (("joint_position", 0.01), ("joint_velocity", 0.02), ("base_velocity", 0.03)):
        assert proprio[name].std() == pytest.approx(scale, rel=0.1), name
        assert abs(proprio[name].mean()) < 0.1 * scale, name
    assert (proprio["end_effector"] == 0).all() and (proprio["last_action"] == 0).all()
    assert stacked["goal"][:, :2].std() == pytest.approx(0.04 / GOAL_SCALE_M, rel=0.1)
    assert (stacked["scandots_all"] == 0).all()

    offset, flag_change = tokens(torch.tensor(stacked["scandots"]))
    valid = np.tile(tokens(clean.get_observations()["scandots"])[1] == 1, (8, 1, 1))
    assert (flag_change == 0).all() and (offset[~valid] == 0).all()
    assert np.abs(offset[valid]).max() <= 0.05 + 1e-6
    assert offset[valid].std() == pytest.approx(0.05 / np.sqrt(3), rel=0.05)
    assert (difference["scandots"][0] != difference["scandots"][1]).any()  # drawn anew
