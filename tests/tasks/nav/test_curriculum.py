"""Training levels: how they move, what they do to the corridors, and that a resumed run keeps them."""

import io

import numpy as np
import pytest
import torch
from nav_worlds import actions, assert_same, run

from spin_rl.tasks.common.config import CurriculumConfig
from spin_rl.tasks.nav.config import NavConfig, NavNoise


def succeed(env, worlds):
    """One step in which some worlds reach their goals, which were moved to where they stand."""
    env.goal[worlds] = env.sim.views.qpos[worlds, :2]
    env.step(env.sim.views.action.clone())


def widths(env):
    """Free width between the side walls of straight corridors."""
    scenes = env.sim.layout.scenes()
    walls = [(scene.pos[:2, 1], scene.half_size[:2, 1]) for scene in scenes]
    return np.array([np.ptp(y) - half.sum() for y, half in walls])


def test_success_raises_and_failure_lowers(nav_env):
    nav_env.level.fill_(0.5)
    succeed(nav_env, [0, 3])
    assert nav_env.level.tolist() == pytest.approx([0.6, 0.5, 0.5, 0.6, 0.5, 0.5, 0.5, 0.5])
    nav_env.sim.views.qvel[5] = torch.nan
    succeed(nav_env, [0])
    assert nav_env.level.tolist() == pytest.approx([0.7, 0.5, 0.5, 0.6, 0.5, 0.45, 0.5, 0.5])


def test_timeout_is_a_failure(make_nav_env):
    env = make_nav_env(NavConfig(episode_s=0.3, curriculum=CurriculumConfig(start=0.2, down=0.15)), 2)
    held = env.sim.views.action.clone()
    for wanted in (0.2, 0.2, 0.05, 0.05, 0.05, 0.0):
        env.step(held)
        assert env.level.tolist() == pytest.approx([wanted] * 2)


def test_levels_stay_between_0_and_1(nav_env):
    nav_env.level[:4], nav_env.level[4:] = 0.97, 0.02
    nav_env.sim.views.qvel[4:] = torch.nan
    succeed(nav_env, [0, 1, 2, 3])
    assert nav_env.level.tolist() == [1.0] * 4 + [0.0] * 4


def test_disabled_curriculum_stays(make_nav_env):
    cfg = NavConfig(episode_s=0.3, curriculum=CurriculumConfig(enabled=False, start=1.0))
    env = make_nav_env(cfg, 2)
    succeed(env, [0])
    for _ in range(4):
        env.step(env.sim.views.action.clone())
    assert env.level.tolist() == [1.0, 1.0] and env.episode_stats()["level"] == 1.0


@pytest.mark.parametrize(("level", "width", "most"), [(0.0, 1.6, 1), (0.5, 1.3, 3), (1.0, 1.0, 5)])
def test_level_narrows_and_fills_the_corridor(nav_env, level, width, most):
    nav_env.set_cells([1] * 8, [-1] * 8)
    nav_env.level.fill_(level)
    counts = []
    for _ in range(6):
        nav_env.reset()
        assert widths(nav_env) == pytest.approx(np.full(8, width), abs=1e-4)
        counts.extend(nav_env.sim.layout.num_obstacles.numpy())
    assert max(counts) <= most and (level == 0.0 or max(counts) >= most - 1)


def test_saved_state_continues_with_the_same_episodes(make_nav_env):
    noise = NavNoise(0.01, 0.01, 0.01, 0.01, 0.01)
    cfg = NavConfig(episode_s=0.6, noise=noise, curriculum=CurriculumConfig(start=0.4, down=0.1))
    env = make_nav_env(cfg, 4, seed=9)
    succeed(env, [1])
    run(env, actions(14, 4))
    buffer = io.BytesIO()
    torch.save(env.state_dict(), buffer)
    buffer.seek(0)
    state = torch.load(buffer, weights_only=True)
    assert len(set(env.level.tolist())) > 1

    resumed = make_nav_env(cfg, 4, seed=9)
    resumed.load_state_dict(state)
    env.reset()
    assert resumed.level.tolist() == env.level.tolist()
    for ours, theirs in zip(resumed.sim.layout.scenes(), env.sim.layout.scenes(), strict=True):
        np.testing.assert_array_equal(ours.active, theirs.active)
        np.testing.assert_array_equal(ours.pos[ours.active], theirs.pos[ours.active])
        np.testing.assert_array_equal(ours.start, theirs.start)
        np.testing.assert_array_equal(ours.goal, theirs.goal)
    assert_same(run(resumed, actions(14, 4, seed=1)), run(env, actions(14, 4, seed=1)))


def test_state_of_another_number_of_worlds_keeps_the_mean_level(make_nav_env):
    env, wider = make_nav_env(num_envs=2), make_nav_env(num_envs=4)
    env.level[0], env.level[1] = 0.2, 0.6
    wider.load_state_dict(env.state_dict())
    assert wider.level.tolist() == pytest.approx([0.4] * 4)
