"""Reward terms of the navigation task, each against a table of cases, and their sum in the environment."""

import pytest
import torch
from hydra import compose, initialize_config_dir
from tensordict import TensorDict

from spin_rl.paths import CONF_DIR
from spin_rl.tasks.common import episode
from spin_rl.tasks.common import rewards as common
from spin_rl.tasks.common.compose import compose as compose_
from spin_rl.tasks.nav import rewards
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.spec import NAV


def transition(**values) -> rewards.NavTransition:
    """Two worlds in which nothing happens, but for the given values."""
    quiet = {
        "progress": torch.zeros(2),
        "goal_distance": torch.full((2,), 3.0),
        "goal_speed": torch.zeros(2),
        "qvel": torch.zeros(2, 13),
        "success": torch.zeros(2, dtype=torch.bool),
        "collision": torch.zeros(2, dtype=torch.bool),
        "self_contact": torch.zeros(2, dtype=torch.bool),
        "action": torch.zeros(2, 10),
        "last_action": torch.zeros(2, 10),
        "observations": TensorDict(batch_size=[2]),
        "haste": torch.zeros(2),
        "information": torch.zeros(2),
    }
    return rewards.NavTransition(**quiet | values)


YES_IN_SECOND = torch.tensor([False, True])


@pytest.mark.parametrize(
    ("term", "values", "wanted"),
    [
        ("progress", {"progress": torch.tensor([0.08, -0.02])}, [0.08, -0.02]),
        ("self_contact", {"self_contact": YES_IN_SECOND}, [0, 1]),
        ("goal_distance", {"goal_distance": torch.tensor([0.1, 4.0])}, [0.1, 4.0]),
        ("goal_speed", {"goal_speed": torch.tensor([0.5, -0.3])}, [0.5, 0.3]),
        ("clearance", {"haste": torch.tensor([0.0, 0.4])}, [0, 0.4]),
        ("information", {"information": torch.tensor([-1.0, 2.0])}, [-1, 2]),
    ],
)
def test_term(term, values, wanted):
    result = rewards.TERMS[term](transition(**values))
    assert result.dtype == torch.float32 and result.tolist() == pytest.approx(wanted)


def test_shared_terms_go_by_their_names():
    shared = ("success", "collision", "time", "joint_velocity", "action_rate")
    assert all(rewards.TERMS[name] is getattr(common, name) for name in shared)


@pytest.mark.parametrize("term", ["reach", "sucess"])
def test_terms_of_another_task_and_of_none_are_unknown(term):
    with pytest.raises(ValueError, match=rf"^reward\.{term}: unknown term; choose from progress, "):
        NavConfig(reward={term: 1.0})


@pytest.mark.parametrize(
    ("name", "scales"),
    [
        ("paper", {"goal_distance": -0.1, "goal_speed": 0.1, "joint_velocity": -0.03}),
        ("paper_printed", {"goal_distance": 0.1, "goal_speed": 0.1, "joint_velocity": -0.03}),
    ],
)
def test_paper_rewards_compose(name, scales):
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        assert NAV.configure(compose("train", [f"reward={name}"])).reward == scales


@pytest.mark.parametrize("scenario", [1, 2])
def test_progress_sums_to_the_path_that_was_made(nav_env, scenario):
    nav_env.set_cells([scenario] * nav_env.num_envs, [0] * nav_env.num_envs)
    nav_env.reset()
    views = nav_env.sim.views

    def path_left():
        delta = (nav_env.goal - views.qpos[:, :2]).abs()
        return delta.sum(-1) if scenario == 2 else delta.norm(dim=-1)

    drive = views.action.clone()
    drive[:, 0] = 1.0
    initial, last = path_left(), path_left()
    total = torch.zeros(nav_env.num_envs)
    running = torch.ones(nav_env.num_envs, dtype=torch.bool)
    for _ in range(6):
        nav_env.step(drive)
        total += running * nav_env.last_transition.progress
        running &= nav_env.outcome == episode.RUNNING
        last = torch.where(running, path_left(), last)
    assert (total.abs() > 0.05)[running].sum() >= 3
    torch.testing.assert_close(total[running], (initial - last)[running], atol=1e-5, rtol=0)


def test_reward_is_the_scaled_sum_of_its_terms(make_nav_env):
    scales = {"progress": 2.0, "time": -0.5, "goal_distance": 0.25, "goal_speed": 0.5, "action_rate": -0.1}
    env = make_nav_env(NavConfig(reward=scales), 3)
    drive = env.sim.views.action.clone()
    drive[:, 0] = torch.tensor([1.0, 0.5, -1.0])
    for _ in range(4):
        before = env.sim.views.action.clone()
        _, reward, done, _ = env.step(drive)
        assert not done.any()
        qpos, qvel = env.sim.views.qpos, env.sim.views.qvel
        to_goal = env.goal - qpos[:, :2]
        distance = to_goal.norm(dim=-1)
        speed = (qvel[:, :2] * to_goal).sum(-1) / distance
        wanted = 2.0 * env.last_transition.progress - 0.5 + 0.25 * distance + 0.5 * speed.abs()
        wanted -= 0.1 * (drive - before).square().sum(-1)
        torch.testing.assert_close(reward, wanted, atol=1e-5, rtol=0)
    stats = env.episode_stats()
    assert stats["reward/time"] == pytest.approx(-0.5)
    assert set(scales) == {key.removeprefix("reward/") for key in stats if key.startswith("reward/")}


def test_task_without_a_reward_runs(make_nav_env):
    env = make_nav_env(NavConfig(reward={}), 2)
    _, reward, _, _ = env.step(env.sim.views.action.clone())
    assert reward.tolist() == [0.0, 0.0]
    assert env.episode_stats()["episodes"] == 0


def test_a_step_knows_what_the_policy_saw(make_nav_env):
    env = make_nav_env()
    before = env.reset()
    for _ in range(3):
        after = env.step(torch.zeros(env.num_envs, 10, device=env.device))[0]
        for name, value in env.last_transition.observations.items():
            torch.testing.assert_close(value, before[name], rtol=0, atol=0)
        before = after


def test_terms_from_outside_are_nested_in_a_configuration(monkeypatch):
    values = compose_("train", ["+reward.torch.zeros=0.5"])
    monkeypatch.setattr(common, "outside_term", lambda name: None)
    assert NAV.configure(values).reward["torch.zeros"] == 0.5
