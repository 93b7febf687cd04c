"""A noisy map as an observation group: on where it is wanted, and without effect on anything else."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from nav_worlds import actions, assert_same, run

from spin_rl.benchmark import settings
from spin_rl.sensors.noisy_map import MapConfig
from spin_rl.tasks.common.compose import compose
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.spec import NAV, NAV_GROUPS

NUM_ENVS = 6
CONFIG = NavConfig(map=MapConfig(enabled=True), episode_s=0.5)


@pytest.fixture(scope="module")
def env(make_nav_env):
    return make_nav_env(CONFIG, NUM_ENVS, seed=5)


def records(env, steps=8):
    env.reseed(5)
    env.reset()
    return run(env, actions(steps, NUM_ENVS))


def test_everything_else_is_as_without_a_map(env, make_nav_env):
    plain = make_nav_env(replace(CONFIG, map=MapConfig()), NUM_ENVS, seed=5)
    assert tuple(plain.get_observations().keys()) == NAV_GROUPS
    with_map, without = records(env), records(plain)
    for step in with_map:
        assert step.pop("scandots_map").shape == (NUM_ENVS, without[0]["scandots_all"].shape[1])
    assert_same(with_map, without)


def test_same_seed_gives_the_same_map_and_graph_equals_eager(env, make_nav_env):
    first = records(env)
    assert any(step["done"].any() for step in first)
    assert_same(first, records(env))
    assert_same(first, records(make_nav_env(CONFIG, NUM_ENVS, seed=5, capture=False)))
    env.reseed(6)
    assert not np.array_equal(env.reset()["scandots_map"].cpu().numpy(), first[0]["scandots_map"])


def test_map_knows_what_the_camera_does_not_see(env):
    env.reset()
    obs = env.get_observations()
    seen, near, mapped = (
        obs[name].view(NUM_ENVS, -1, 32)[..., 24:] for name in ("scandots", "scandots_all", "scandots_map")
    )
    assert torch.equal(near, mapped) and mapped.sum() > 1.2 * seen.sum()
    exact, read = (obs[name].view(NUM_ENVS, -1, 32)[..., :24] for name in ("scandots_all", "scandots_map"))
    moved = (exact != read).view(NUM_ENVS, -1, 8, 3).any(-1)
    assert torch.equal(moved, mapped > 0)


def test_an_episodes_offset_lasts_and_the_next_one_has_another(env):
    env.reseed(5)
    env.reset()

    def offsets():
        """Mean error in the world's frame, per world."""
        obs = env.get_observations()
        exact, read = (obs[name].view(NUM_ENVS, -1, 32) for name in ("scandots_all", "scandots_map"))
        known = exact[..., 24:, None]
        error = (read[..., :24] - exact[..., :24]).view(NUM_ENVS, -1, 8, 3) * known
        error = error.flatten(1, 2).sum(1) / known.flatten(1, 2).sum(1)
        yaw = env.sim.views.qpos[:, 2]
        east = yaw.cos() * error[:, 0] - yaw.sin() * error[:, 1]
        north = yaw.sin() * error[:, 0] + yaw.cos() * error[:, 1]
        return torch.stack([east, north], -1)

    before = offsets()
    hold = env.sim.views.action.clone()
    hold[:, 1] = 1.0  # turns on the spot
    _, _, done, _ = env.step(hold)
    later = offsets()
    assert not done.any() and (before != later).all()
    assert (before - later).norm(dim=-1).median() < 0.05 < before.norm(dim=-1).median()
    env.reset()
    assert (offsets() - later).norm(dim=-1).median() > 0.05


def test_a_policy_of_mapping_is_measured_with_its_map():
    trained = compose("train", ["algo=mapping"])
    task = NAV.configure(settings.for_policy(compose("eval"), trained, []))
    assert task.map == MapConfig(enabled=True, errors="mixture") and task.camera_pose == (0.0, -0.6)
    asked = ["task.map.errors=none"]
    task = NAV.configure(settings.for_policy(compose("eval", asked), trained, asked))
    assert task.map == MapConfig(enabled=True, errors="none")
    assert trained["runner"]["obs_groups"]["actor"] == ["proprio", "goal", "scandots_map"]
    assert not NAV.as_trained([]).map.enabled
