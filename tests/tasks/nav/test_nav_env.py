"""Stepping and resetting the navigation task: masks, graphs, seeds, outcomes."""

import mujoco
import numpy as np
import pytest
import torch
import warp as wp
from nav_worlds import actions, assert_same, run, snapshot

from spin_rl import robot
from spin_rl.scenes.builder import PARKED_Z_M, native_model
from spin_rl.scenes.layout import PoolSpec
from spin_rl.tasks.common import episode
from spin_rl.tasks.nav.config import NavConfig, NavNoise

NOISE = NavNoise(0.005, 0.02, 0.02, 0.02, 0.01)


def reset_worlds(env, worlds):
    mask = np.isin(np.arange(env.num_envs), worlds)
    with wp.ScopedDevice(env.device):
        env._launch_reset(wp.array(mask, dtype=bool))


def test_reset_leaves_the_neighbours_alone(nav_env, make_nav_env):
    sequence = actions(12, nav_env.num_envs)
    twin = make_nav_env(seed=3)
    assert_same(run(nav_env, sequence[:6]), run(twin, sequence[:6]))
    before = snapshot(nav_env)
    chosen, others = [1, 4], [0, 2, 3, 5, 6, 7]
    reset_worlds(nav_env, chosen)
    after = snapshot(nav_env)
    for name in before:
        np.testing.assert_array_equal(before[name][others], after[name][others], err_msg=name)
    for world in chosen:
        assert (before["layout_pos"][world] != after["layout_pos"][world]).any()
    # Nor does the rest of their episodes know of it.
    assert_same(run(nav_env, sequence[6:]), run(twin, sequence[6:]), others)


def test_reset_worlds_stand_at_their_layouts_start(nav_env):
    run(nav_env, actions(4, nav_env.num_envs))
    reset_worlds(nav_env, [1, 4])
    now = snapshot(nav_env)
    for world in (1, 4):
        scene = nav_env.sim.layout.scene(world)
        native = native_model(scene)
        joints = dict(zip(robot.JOINTS, scene.start_joints, strict=True))
        wanted = robot.qpos_from_joints(native, joints)
        wanted[:3] = scene.start
        np.testing.assert_allclose(now["qpos"][world], wanted, atol=1e-6)
        assert (now["qvel"][world] == 0).all() and (now["base_velocity"][world] == 0).all()
        assert now["episode_length"][world] == 0 and now["time"][world] == 0
        data = mujoco.MjData(native)
        mujoco.mj_kinematics(native, data)
        for slot, name in enumerate(PoolSpec().geom_names()):
            geom = nav_env.sim.mj_model.geom(name).id
            position = now["geom_xpos"][world, geom]
            if scene.active[slot]:
                np.testing.assert_allclose(position, data.geom(name).xpos, atol=1e-6)
                np.testing.assert_allclose(now["geom_size"][world, geom], native.geom(name).size, atol=1e-6)
            else:
                assert position[2] == np.float32(PARKED_Z_M)
    assert (now["episode_length"][[0, 2, 3, 5, 6, 7]] == 4).all()


def test_start_action_holds_the_start_pose(nav_env):
    start = nav_env.sim.views.qpos.clone()
    held = nav_env.sim.views.action.clone()
    assert (held[:, :2] == 0).all() and (held.abs() <= 1).all() and (held[:, 2:] != 0).any()
    for _ in range(10):
        _, _, done, _ = nav_env.step(held)
        assert not done.any()
    assert (nav_env.sim.views.qpos - start).abs().max() < 1e-3  # [m, rad] after 1 s


def test_graph_equals_eager_and_seeds_matter(make_nav_env):
    # One second per episode: all worlds are reset several times, at the curriculum's and the noise's mercy.
    cfg = NavConfig(
        episode_s=1.0, noise=NOISE, reward={"progress": 1.0, "collision": -1.0, "action_rate": -0.1}
    )
    sequence = actions(30, 4)
    captured = make_nav_env(cfg, 4, seed=5)
    first = run(captured, sequence)
    assert sum(step["done"].sum() for step in first) >= 3 * 4
    assert_same(first, run(make_nav_env(cfg, 4, seed=5, capture=False), sequence))
    # The same environment again, as if it were new.
    captured.reseed(5)
    captured.reset()
    assert_same(first, run(captured, sequence))
    captured.reseed(6)
    captured.reset()
    other = run(captured, sequence)
    assert all((first[i]["qpos"][:, :8] != other[i]["qpos"][:, :8]).any(axis=1).all() for i in (0, 15, 29))


def test_worlds_differ_from_each_other(nav_env):
    now = snapshot(nav_env)
    for name in ("qpos", "layout_pos", "lag", "speed_scale"):
        assert len(np.unique(now[name].reshape(nav_env.num_envs, -1), axis=0)) == nav_env.num_envs, name
    dynamics = nav_env.cfg.dynamics
    for column, (low, high) in enumerate((dynamics.base_lag_s, dynamics.joint_lag_s)):
        assert (now["lag"][:, column] >= low).all() and (now["lag"][:, column] <= high).all()
    low, high = dynamics.speed_scale
    assert (now["speed_scale"] >= low).all() and (now["speed_scale"] <= high).all()


def test_outcome_and_contacts_are_those_before_the_reset(nav_env):
    drive = nav_env.sim.views.action.clone()
    drive[:, 0] = 1.0
    drive[:, 1] = torch.linspace(-1, 1, nav_env.num_envs)  # most will hit a wall
    ended = torch.zeros(nav_env.num_envs, dtype=torch.bool)
    for _ in range(30):
        goal = nav_env.goal.clone()
        _, _, done, extras = nav_env.step(drive)
        collided = nav_env.outcome == episode.COLLISION
        touched = nav_env.sim.views.part_contacts.any(-1)
        assert (touched == collided).all() and (done.bool() == (nav_env.outcome > 0)).all()
        assert not extras["time_outs"].any()
        step = nav_env.last_transition
        assert (step.collision == collided).all()
        final = step.qvel[:, :2].norm(dim=-1)
        for world in torch.nonzero(done).flatten().tolist():
            start = nav_env.sim.layout.start.numpy()[world]
            assert nav_env.sim.views.qpos[world, :3].tolist() == pytest.approx(start.tolist(), abs=1e-6)
            assert (nav_env.sim.views.qvel[world] == 0).all() and final[world] > 0
            assert nav_env.episode_length_buf[world] == 0
            assert (nav_env._goal_before[world] == goal[world]).all()
        ended |= collided
    assert ended.sum() >= 4


def test_time_limit_is_a_timeout_and_no_failure_of_the_value(make_nav_env):
    env = make_nav_env(NavConfig(episode_s=0.5), 2)
    held = env.sim.views.action.clone()
    for i in range(5):
        _, _, done, extras = env.step(held)
        assert done.bool().tolist() == extras["time_outs"].tolist() == [i == 4] * 2
    assert (env.outcome == episode.TIMEOUT).all()
    stats = env.episode_stats()
    assert stats["episodes"] == 2 and stats["timeout_rate"] == 1.0 and stats["success_rate"] == 0.0
    assert stats["mean_length_s"] == pytest.approx(0.5)
    assert stats["mean_return"] == pytest.approx(5 * -0.01, abs=1e-3)  # the time penalty alone


def test_goal_reached_is_a_success(nav_env):
    drive = nav_env.sim.views.action.clone()
    nav_env.goal[2] = nav_env.sim.views.qpos[2, :2] + 0.1
    _, reward, done, extras = nav_env.step(drive)
    assert nav_env.outcome.tolist() == [0, 0, episode.SUCCESS, 0, 0, 0, 0, 0]
    assert done.tolist() == [0, 0, 1, 0, 0, 0, 0, 0] and not extras["time_outs"].any()
    assert reward[2] > 9 and (reward[[0, 1, 3]] < 1).all()


def test_cells_fix_scenario_and_difficulty(nav_env):
    nav_env.set_cells([1, 1, 1, 2, 2, 2, 0, 0], [0, 1, 2, 0, 1, 2, 2, -1])
    nav_env.reset()
    layout = nav_env.sim.layout
    assert layout.scenario.numpy()[:6].tolist() == [1, 1, 1, 2, 2, 2]
    assert layout.difficulty.numpy()[:7].tolist() == [0, 1, 2, 0, 1, 2, 2]
    assert layout.bend.numpy()[:6].tolist() == [0, 0, 0, 1, 1, 1]
    counts = layout.num_obstacles.numpy()
    assert (counts[[0, 3]] <= 1).all() and counts[2] > 3 and counts[5] > 3


def test_manual_reset_forgets_running_episodes(nav_env):
    drive = nav_env.sim.views.action.clone()
    for _ in range(3):
        nav_env.step(drive)
    nav_env.reset()
    nav_env.goal[0] = nav_env.sim.views.qpos[0, :2] + 0.05
    nav_env.step(nav_env.sim.views.action.clone())
    stats = nav_env.episode_stats()
    assert stats["episodes"] == 1 and stats["mean_length_s"] == pytest.approx(0.1)
