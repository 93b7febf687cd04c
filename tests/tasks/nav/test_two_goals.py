"""Scenes with a place to drive to before the goal."""

import numpy as np
import pytest
import torch

from spin_rl import robot
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.tasks.common.episode import SUCCESS, TIMEOUT
from spin_rl.tasks.nav.config import NavConfig


def there_and_back(ahead, back, *, has_via=True) -> Scene:
    """Nothing but a box far away."""
    scene = Scene.empty(PoolSpec())
    scene.active[6] = True
    scene.pos[6] = (0.0, -4.0, 0.05)
    scene.start_joints[:] = [robot.STOWED[joint] for joint in robot.JOINTS]
    scene.has_via, scene.via[:], scene.goal[:] = has_via, (ahead, 0.0), (back, 0.0)
    return scene


def drive(env, commands):
    """Forward actions step by step; per step the goals, whether and how worlds ended, and progress."""
    record = []
    for forward in commands:
        action = torch.zeros(env.num_envs, len(robot.ACTIONS), device=env.device)
        action[:, 0] = forward
        obs, _, done, _ = env.step(action)
        progress = env.last_transition.progress.numpy(force=True).copy()
        goal, outcome = (values.numpy(force=True).copy() for values in (env.goal, env.outcome))
        record.append((goal, done.numpy(force=True), outcome, progress, obs["goal"]))
        if done.any():
            break
    return record


def test_the_goal_behind_counts_after_the_one_ahead(make_nav_env):
    cfg = NavConfig(robot_profile="reversing", episode_s=8.0)
    env = make_nav_env(cfg, num_envs=1, scene=there_and_back(1.0, -0.6))
    assert env.goal.numpy(force=True).tolist() == [[1.0, 0.0]]
    record = drive(env, [1.0] * 25 + [-1.0] * 60)
    goals = np.array([goal[0, 0] for goal, *_ in record])
    arrived = int(np.argmax(goals < 0.0))
    assert (
        (goals[:arrived] == 1.0).all() and 0 < arrived < 26 and (goals[arrived:-1] == np.float32(-0.6)).all()
    )
    assert record[arrived][1].tolist() == [0]  # the first goal ends nothing
    assert record[-1][2].tolist() == [SUCCESS]
    assert env.final_way[0] == pytest.approx(1.0 + 1.6, abs=1e-5)
    # Progress is towards the goal of that moment; nothing jumps where it changes.
    progress = np.array([step[3][0] for step in record])
    assert (
        (progress[2:arrived] > 0.0).all() and (progress[-3:] > 0.0).all() and np.abs(progress).max() < 0.045
    )
    # What is observed is the goal behind, in the base frame, as soon as it counts.
    assert record[arrived - 1][4][0, 0] > 0.0 and record[arrived][4][0, 0] < -0.5
    # The next episode begins with the first goal again.
    assert env.goal.numpy(force=True).tolist() == [[1.0, 0.0]]


def test_the_goal_behind_alone_ends_nothing(make_nav_env):
    cfg = NavConfig(robot_profile="reversing", episode_s=5.0)
    env = make_nav_env(cfg, num_envs=1, scene=there_and_back(1.0, -0.6))
    assert drive(env, [-0.5] * 50)[-1][2].tolist() == [TIMEOUT]
    alone = make_nav_env(cfg, num_envs=1, scene=there_and_back(1.0, -0.6, has_via=False))
    assert drive(alone, [-0.5] * 50)[-1][2].tolist() == [SUCCESS]


def test_the_paper_s_robot_reverses_slowly(make_nav_env):
    """Why scene=shuttle asks for robot=reversing."""
    ways = {}
    for profile in ("paper", "reversing"):
        env = make_nav_env(NavConfig(robot_profile=profile), num_envs=1, scene=there_and_back(3.0, -3.0))
        drive(env, [-1.0] * 20)
        ways[profile] = -float(env.sim.views.qpos[0, 0])
    assert ways["paper"] < 0.2 and ways["reversing"] > 0.6
