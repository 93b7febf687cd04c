"""The task as a gymnasium vector environment."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode

import spin_rl.tasks.gym_env  # noqa: F401  (registers the environment)
from spin_rl.tasks.common import episode
from spin_rl.tasks.nav.config import NavConfig


@pytest.fixture(scope="module")
def env(device):
    made = gym.make_vec("spin_rl/Nav-v0", num_envs=4, cfg=NavConfig(episode_s=0.8), device=device, seed=2)
    yield made
    made.close()


def test_registered_with_defaults(env):
    assert env.num_envs == 4 and env.spec.id == "spin_rl/Nav-v0"
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert env.single_action_space.shape == (10,) and env.action_space.shape == (4, 10)
    assert env.single_observation_space["proprio"].shape == (31,)


def test_spaces_contain_what_comes_out(env):
    env.action_space.seed(0)
    obs, info = env.reset(seed=1)
    assert obs in env.observation_space and info == {}
    for _ in range(12):
        obs, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert obs in env.observation_space
        assert reward.shape == (4,) and reward.dtype == np.float32 and np.isfinite(reward).all()
        assert terminated.dtype == truncated.dtype == np.bool_ and not (terminated & truncated).any()
        ended = info["outcome"] != episode.RUNNING
        np.testing.assert_array_equal(ended, terminated | truncated)
        np.testing.assert_array_equal(truncated, info["outcome"] == episode.TIMEOUT)


def test_same_step_autoreset(env):
    first, _ = env.reset(seed=1)
    held = first["proprio"][:, -10:]
    for step in range(8):
        obs, _, terminated, truncated, info = env.step(held)
        assert not terminated.any() and truncated.all() == truncated.any() == (step == 7)
    assert [env.unwrapped.outcome_name(o) for o in info["outcome"]] == ["timeout"] * 4
    # Already the next episodes: other corridors, robots at rest.
    assert (obs["goal"] != first["goal"]).any(axis=1).all()
    np.testing.assert_array_equal(obs["proprio"][:, 8:18], 0.0)
    np.testing.assert_array_equal(env.unwrapped.env.episode_length_buf.cpu().numpy(), 0)


def test_seeds(env):
    def play(seed):
        env.action_space.seed(7)
        record = [env.reset(seed=seed)]
        record += [env.step(env.action_space.sample()) for _ in range(10)]
        return record

    first, again, other = play(3), play(3), play(4)
    assert data_equivalence(first, again, exact=True)
    assert not data_equivalence(first, other)
    env.reset(seed=3)
    assert not data_equivalence(env.reset(), first[0])  # no seed: the next episodes


def test_gymnasiums_wrappers_work(env):
    wrapped = gym.wrappers.vector.RecordEpisodeStatistics(env)
    wrapped.reset(seed=1)
    held = env.unwrapped.env.sim.views.action.cpu().numpy()
    for _ in range(8):
        _, reward, _, _, info = wrapped.step(held)
    np.testing.assert_array_equal(info["episode"]["l"], 8)
    assert info["episode"]["r"] == pytest.approx(8 * reward, abs=1e-2)
