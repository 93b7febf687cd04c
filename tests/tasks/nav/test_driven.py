"""What navigation keeps of every drive: the way at its start and the path driven, for SPL."""

import numpy as np
import torch

from spin_rl import robot
from spin_rl.benchmark.metrics import spl
from spin_rl.planning.solvability import scene_params
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.tasks.common.episode import SUCCESS
from spin_rl.tasks.nav.config import NavConfig

FORWARD = robot.ACTIONS.index("base_forward")


def open_floor(x, goal_x):
    """Nothing but a box far away; the robot faces its goal."""
    scene = Scene.empty(PoolSpec())
    scene.active[6] = True
    scene.pos[6] = (0.0, -4.0, 0.05)
    scene.start[:] = (x, 0.0, 0.0)
    scene.start_joints[:] = [robot.STOWED[joint] for joint in robot.JOINTS]
    scene.goal[:] = (goal_x, 0.0)
    return scene


def test_spl_of_a_straight_drive_and_of_a_detour(make_nav_env):
    """World 1 backs up first, world 2 goes the wrong way for good."""
    trips = [open_floor(0.0, 1.5), open_floor(-0.5, 1.0), open_floor(0.0, 2.5)]
    env = make_nav_env(NavConfig(stop_on_collision=False), num_envs=3, scene=trips)
    ends = {}
    places = [env.sim.views.qpos[:, :2].numpy(force=True).copy()]
    for step in range(150):
        action = torch.zeros(3, 10, device=env.device)
        action[:, FORWARD] = torch.tensor([1.0, -1.0 if step < 20 else 1.0, -0.3])
        _, _, done, _ = env.step(action)
        places.append(env.final_qpos[:, :2].numpy(force=True).copy())
        for world in torch.nonzero(done).flatten().tolist():
            if world not in ends:
                success = int(env.outcome[world]) == SUCCESS
                ends[world] = step + 1, success, float(env.final_way[world]), float(env.final_driven[world])
        if 0 in ends and 1 in ends:
            break
    assert sorted(ends) == [0, 1] and ends[0][1] and ends[1][1]
    # Oracle: the base's positions as NumPy adds them up.
    path = np.array(places)
    driven = [np.linalg.norm(np.diff(path[: ends[w][0] + 1, w], axis=0), axis=1).sum() for w in (0, 1)]
    np.testing.assert_allclose([ends[w][3] for w in (0, 1)], driven, rtol=1e-4)
    np.testing.assert_allclose([ends[w][2] for w in (0, 1)], 1.5, atol=0.1)
    success, way = np.array([True, True, False]), np.array([ends[0][2], ends[1][2], 2.5])
    assert spl(success, way, np.array([*driven, 0.7])) == np.mean([1.0, way[1] / max(way[1], driven[1]), 0.0])
    assert driven[0] < way[0] and driven[1] > 1.2 * way[1]


def test_a_new_episode_starts_at_zero_and_leaves_the_others(make_nav_env):
    env = make_nav_env(NavConfig(scene=scene_params("open"), episode_s=1.0), num_envs=4)
    action = torch.zeros(4, 10, device=env.device)
    action[:, FORWARD] = 1.0
    for _ in range(5):
        env.step(action)
    before = env.final_driven.clone()
    assert (before > 0.05).all()
    env.episode_length_buf[1] = env.max_episode_length
    env.step(action)
    assert env.outcome[1] != 0 and env.final_driven[1] > before[1]  # still that of the episode that ended
    env.step(action)
    assert env.final_driven[1] < 0.5 * before[1]
    assert (env.final_driven[[0, 2, 3]] > before[[0, 2, 3]]).all()
