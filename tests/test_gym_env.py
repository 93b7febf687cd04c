"""The tasks as gymnasium vector environments."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import vector as wrappers

import spin_rl.gym_env
from spin_rl.config import ConfigError
from spin_rl.tasks.nav.config import NavConfig

STEPS = 8
NAV = "spin_rl/Nav-v0"


def make(device, mode=AutoresetMode.SAME_STEP, **options):
    return gym.make_vec(
        NAV,
        num_envs=4,
        cfg=NavConfig(),
        device=device,
        seed=2,
        max_episode_steps=STEPS,
        autoreset_mode=mode,
        **options,
    )


@pytest.fixture(scope="module")
def env(device):
    made = make(device)
    yield made
    made.close()


@pytest.fixture(scope="module")
def next_step(device):
    return make(device, "NextStep")


def held(obs):
    """Actions that keep the robot as it is at the start of an episode."""
    return obs["proprio"][:, -10:]


def test_registered_with_defaults(env):
    assert env.num_envs == 4 and env.spec.id == NAV
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP and env.metadata["render_fps"] == 10
    assert env.single_action_space.shape == (10,) and env.action_space.shape == (4, 10)
    assert env.single_observation_space["proprio"].shape == (31,)
    assert env.render() is None


def test_spaces_contain_what_comes_out(env):
    env.action_space.seed(0)
    obs, info = env.reset(seed=1)
    assert obs in env.observation_space and info == {}
    for _ in range(12):
        obs, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert obs in env.observation_space
        assert reward.shape == (4,) and reward.dtype == np.float32 and np.isfinite(reward).all()
        assert terminated.dtype == truncated.dtype == np.bool_ and not (terminated & truncated).any()
        np.testing.assert_array_equal(info["outcome"] != "running", terminated | truncated)
        np.testing.assert_array_equal(truncated, info["outcome"] == "timeout")


@pytest.mark.parametrize("task", ["pick", "fetch"])
def test_the_other_tasks(task, device):
    cfg = spin_rl.evaluation_config(task, ["task.depth.enabled=true"])
    made = gym.make_vec(spin_rl.gym_env.IDS[task], num_envs=2, cfg=cfg, device=device)
    obs, _ = made.reset(seed=1)
    assert obs in made.observation_space and obs["depth"].dtype == np.uint8
    obs, _, _, _, info = made.step(made.action_space.sample())
    assert obs in made.observation_space and info["outcome"].shape == (2,)


def test_same_step_autoreset(env):
    first, _ = env.reset(seed=1)
    for step in range(STEPS):
        obs, _, terminated, truncated, info = env.step(held(first))
        assert not terminated.any() and truncated.all() == truncated.any() == (step == STEPS - 1)
        assert ("final_obs" in info) == (step == STEPS - 1)
    assert info["final_info"]["outcome"].tolist() == info["outcome"].tolist() == ["timeout"] * 4
    # Already the next episodes: other corridors, robots at rest.
    assert (obs["goal"] != first["goal"]).any(axis=1).all()
    np.testing.assert_array_equal(obs["proprio"][:, 8:18], 0.0)
    np.testing.assert_array_equal(env.unwrapped.env.episode_length_buf.cpu().numpy(), 0)
    # The last observations are of the episodes that ended: the robots stood still.
    assert info["_final_obs"].all()
    for world, last in enumerate(info["final_obs"]):
        np.testing.assert_allclose(last["goal"], first["goal"][world], atol=0.01)


def test_the_final_observation_is_that_of_a_world_that_goes_on(env, device):
    """The same steps in an environment with a longer limit."""
    longer = gym.make_vec(NAV, num_envs=4, cfg=NavConfig(), device=device, seed=2)
    first, _ = env.reset(seed=5)
    same, _ = longer.reset(seed=5)
    assert data_equivalence(first, same, exact=True)
    for _ in range(STEPS):
        *_, info = env.step(held(first))
        obs, *_ = longer.step(held(first))
    assert (info["outcome"] == "timeout").all()
    for world, last in enumerate(info["final_obs"]):
        for name, value in last.items():
            np.testing.assert_array_equal(value, obs[name][world])


def test_next_step_autoreset(env, next_step):
    same, _ = env.reset(seed=1)
    obs, _ = next_step.reset(seed=1)
    assert data_equivalence(obs, same, exact=True)
    for _ in range(STEPS):
        started, *_, info = env.step(held(same))
        obs, _, terminated, truncated, own = next_step.step(held(same))
    assert truncated.all() and not terminated.any() and "final_obs" not in own
    for world, last in enumerate(info["final_obs"]):
        assert data_equivalence({name: value[world] for name, value in obs.items()}, last, exact=True)
    obs, reward, terminated, truncated, own = next_step.step(np.ones((4, 10), np.float32))
    assert data_equivalence(obs, started, exact=True)  # the action was not taken
    assert not reward.any() and not terminated.any() and not truncated.any()
    assert own["outcome"].tolist() == ["running"] * 4


def test_levels_move_once_an_episode(next_step):
    nav = next_step.unwrapped.env
    obs, _ = next_step.reset(seed=1)
    nav.level.fill_(0.5)
    for _ in range(STEPS + 1):
        next_step.step(held(obs))
    np.testing.assert_allclose(nav.level.cpu().numpy(), 0.5 - nav.cfg.curriculum.down, atol=1e-6)


def test_reset_of_some_worlds(env):
    obs, _ = env.reset(seed=1)
    actions = held(obs)
    before, *_ = env.step(actions)
    mask = np.array([True, False, False, True])
    after, info = env.reset(options={"reset_mask": mask})
    assert info == {}
    for name in before:
        np.testing.assert_array_equal(after[name][~mask], before[name][~mask])
    assert (after["goal"] != before["goal"]).any(axis=1)[mask].all()
    assert env.unwrapped.env.episode_length_buf.cpu().numpy().tolist() == [0, 1, 1, 0]


def test_disabled_autoreset_waits_for_the_mask(device):
    made = make(device, AutoresetMode.DISABLED)
    obs, _ = made.reset(seed=1)
    for _ in range(STEPS):
        _, _, _, truncated, _ = made.step(held(obs))
    assert truncated.all()
    with pytest.raises(gym.error.ResetNeeded, match="reset_mask"):
        made.step(held(obs))
    made.reset(options={"reset_mask": truncated})
    _, _, _, truncated, _ = made.step(held(obs))
    assert not truncated.any()


@pytest.mark.parametrize(
    ("options", "seed", "message"),
    [
        ({"reset_mask": [True, False]}, None, "reset_mask: expected 4 booleans"),
        ({"reset_mask": [0, 1, 1, 0]}, None, "reset_mask: expected 4 booleans"),
        ({"reset_mask": [False] * 4}, None, "reset_mask: expected 4 booleans"),
        ({"reset_mask": [True] * 4}, 3, "seed: restarts"),
        ({"mask": [True] * 4}, None, "options: mask is unknown"),
    ],
)
def test_bad_resets_are_named(env, options, seed, message):
    with pytest.raises(ValueError, match="^" + message):
        env.reset(seed=seed, options=options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"render_mode": "human"}, "render_mode: expected 'rgb_array'"),
        ({"max_episode_steps": 1}, "max_episode_steps: expected a whole number from 2 on, got 1"),
        ({"max_episode_steps": 2.5}, "max_episode_steps: expected a whole number"),
        ({"autoreset_mode": "x"}, "autoreset_mode: expected one of NextStep"),
        ({"cfg": {"a": 1}}, "cfg: expected a NavConfig, got dict"),
    ],
)
def test_bad_arguments_are_named(options, message):
    with pytest.raises(ValueError, match="^" + message):
        gym.make_vec(NAV, num_envs=2, **options)


def test_seeds(env):
    def play(seed):
        env.action_space.seed(7)
        record = [env.reset(seed=seed)]
        record += [env.step(env.action_space.sample())[:4] for _ in range(10)]
        return record

    first, again, other = play(3), play(3), play(4)
    assert data_equivalence(first, again, exact=True)
    assert not data_equivalence(first, other)
    env.reset(seed=3)
    assert not data_equivalence(env.reset(), first[0])  # no seed: the next episodes


def test_a_world_that_turns_non_finite_shows_finite_observations(next_step):
    obs, _ = next_step.reset(seed=1)
    bad = held(obs).copy()
    bad[2] = np.nan
    obs, reward, terminated, _, info = next_step.step(bad)
    assert info["outcome"].tolist() == ["running", "running", "non_finite", "running"]
    assert terminated.tolist() == [False, False, True, False] and np.isfinite(reward).all()
    assert all(np.isfinite(value).all() for value in obs.values())


@pytest.mark.parametrize("mode", [AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP])
def test_gymnasiums_statistics(env, next_step, mode):
    wrapped = wrappers.RecordEpisodeStatistics(env if mode is AutoresetMode.SAME_STEP else next_step)
    obs, _ = wrapped.reset(seed=1)
    for _ in range(STEPS):
        _, reward, _, _, info = wrapped.step(held(obs))
    np.testing.assert_array_equal(info["episode"]["l"], STEPS)
    assert info["episode"]["r"] == pytest.approx(STEPS * reward, abs=1e-2)


def test_gymnasiums_normalization(next_step):
    wrapped = wrappers.NormalizeObservation(wrappers.FlattenObservation(next_step))
    wrapped = wrappers.NormalizeReward(wrapped)
    obs, _ = wrapped.reset(seed=1)
    for _ in range(2 * STEPS):
        obs, reward, *_ = wrapped.step(wrapped.action_space.sample())
    width = sum(space.shape[0] for space in next_step.single_observation_space.values())
    assert obs.shape == (4, width) and np.isfinite(obs).all() and np.isfinite(reward).all()


def test_gymnasiums_videos(device, tmp_path):
    pytest.importorskip("moviepy")
    made = gym.make_vec(NAV, num_envs=2, device=device, max_episode_steps=3, render_mode="rgb_array")
    recorded = wrappers.RecordVideo(made, str(tmp_path), episode_trigger=lambda episode: True)
    recorded.reset(seed=1)
    for _ in range(4):
        recorded.step(recorded.action_space.sample())
    recorded.close()
    assert {file.suffix for file in tmp_path.iterdir()} == {".mp4"}


def test_pictures_show_every_world(device):
    made = make(device, "NextStep", render_mode="rgb_array")
    obs, _ = made.reset(seed=1)
    first = made.render()
    assert len(first) == 4 and all(picture.shape == (448, 720, 3) for picture in first)
    assert all(picture.dtype == np.uint8 for picture in first) and (first[0] != first[1]).any()
    made.step(held(obs))
    assert (made.render()[0] != first[0]).any()


def test_the_configurations_of_training_and_evaluation_differ():
    training, evaluation = spin_rl.training_config("nav"), spin_rl.evaluation_config("nav")
    assert training.curriculum.enabled and training.curriculum.start == 0.0
    assert not evaluation.curriculum.enabled and evaluation.curriculum.start == 1.0
    assert not any(vars(evaluation.noise).values()) and any(vars(training.noise).values())
    hard = spin_rl.evaluation_config("nav", ["task.difficulty=2"])
    assert hard == dataclasses.replace(evaluation, difficulty=2)


def test_the_configuration_of_a_policys_evaluation_has_its_inputs():
    own, given = (
        spin_rl.evaluation_config("nav", overrides, policy="nav-room")
        for overrides in ([], ["task.goal_range_m=2.0"])
    )
    assert own.goal_range_m != spin_rl.evaluation_config("nav").goal_range_m and given.goal_range_m == 2.0


@pytest.mark.parametrize(
    ("make", "given", "message"),
    [
        (spin_rl.evaluation_config, {"task": "nope"}, "task: unknown 'nope'; choose from nav, pick, fetch"),
        (spin_rl.training_config, {"task": "nope"}, "task: unknown 'nope'"),
        (spin_rl.evaluation_config, {"overrides": ["task.dificulty=1"]}, "did you mean task.difficulty"),
        (spin_rl.training_config, {"overrides": ["reward=shape"]}, "reward: unknown 'shape'"),
        (spin_rl.evaluation_config, {"overrides": "robot=re1"}, "overrides: expected a list"),
        (
            spin_rl.evaluation_config,
            {"policy": "pick-depth"},
            "policy: pick-depth was trained with task=pick",
        ),
    ],
)
def test_what_is_no_configuration_is_one_line(make, given, message):
    with pytest.raises(ConfigError) as error:
        make(**given)
    assert message in str(error.value) and "\n" not in str(error.value)


def test_actions_of_another_shape_are_refused(env):
    with pytest.raises(ValueError, match=r"^actions: expected shape \(4, 10\), got \(3, 10\)"):
        env.step(np.zeros((3, 10), np.float32))
