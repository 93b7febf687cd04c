"""A camera that imitates where to look: its actions come there, and only where something is said."""

from types import MappingProxyType

import pytest
import torch
from fake_env import FakeEnv, make_config

from spin_rl.runners import PPORunner
from spin_rl.runners.config import check_config
from spin_rl.tasks.common.compose import compose
from spin_rl.tasks.nav.spec import NAV

TARGET = torch.tensor([0.6, -0.4])


class GazeEnv(FakeEnv):
    """Points with a camera of two actions that does nothing; where to look is said in every other world."""

    num_actions = 4
    camera_actions = (2, 3)
    camera_columns = MappingProxyType({})
    target = TARGET

    def step(self, actions):
        return super().step(actions[:, :2])

    def _observe(self):
        super()._observe()
        gaze = torch.zeros(self.num_envs, 3)
        gaze[::2] = torch.cat([self.target, torch.ones(1)])
        self.observations["gaze"] = gaze


def runner_of(env, num_used=2, **algorithm):
    cfg = make_config(**algorithm)
    cfg["algorithm"] |= {"class_name": "spin_rl.runners.ppo.gaze:GazePPO"}
    cfg["actor"]["distribution_cfg"] = {
        "class_name": "spin_rl.models:PerActionGaussian",
        "init_std": [0.6] * 4,
        "num_used": num_used,
    }
    torch.manual_seed(0)
    return PPORunner(env, cfg)


def distance(runner, env):
    """Of the mean camera actions from where to look, in the worlds where that is said."""
    with torch.no_grad():
        mean = runner.alg.actor(env.get_observations())
    return float((mean[::2, 2:] - TARGET).norm(dim=-1).mean())


def test_the_camera_comes_to_look_there():
    env = GazeEnv()
    runner = runner_of(env, gaze_loss=1.0)
    before = distance(runner, env)
    runner.train(30)
    assert distance(runner, env) < 0.3 * before


def test_the_loss_is_of_what_is_said_alone():
    env = GazeEnv()
    alg = runner_of(env, gaze_loss=0.25).alg
    obs = env.get_observations()
    with torch.no_grad():
        for _ in range(alg.storage.num_steps):
            alg.act(obs)
            obs, rewards, dones, extras = env.step(torch.zeros(env.num_envs, 4))
            alg.process_env_step(obs, rewards, dones, extras)
        alg.compute_returns(obs)
    (batch,) = alg.storage.mini_batches(1)
    alg.actor(batch.observations, hidden_state=batch.states[0], stochastic_output=True, resets=batch.resets)
    weight, loss = alg._extra_losses(batch)["gaze"]
    said = alg.actor.output_mean[..., 2:][batch.targets[..., 2] == 1.0]  # worlds come in any order
    assert weight == 0.25
    torch.testing.assert_close(loss, (said - TARGET).square().sum(-1).mean())


def test_without_anything_to_imitate_it_is_refused():
    with pytest.raises(ValueError, match=r"GazePPO needs the group gaze, task\.teach_gaze=true"):
        runner_of(FakeEnv())


def test_camera_actions_that_the_environment_replaces_count_in_nothing_else():
    with pytest.raises(ValueError, match=r"num_used: GazePPO needs 2, all but the camera's"):
        runner_of(GazeEnv(), num_used=None)


@pytest.mark.parametrize("algo", ["gaze", "wide"])
def test_the_shipped_variants_are_whole(algo):
    values = compose("train", [f"algo={algo}"])
    check_config(values["runner"], NAV.groups, values["num_envs"])
    assert NAV.configure(values).teach_gaze
    assert all("gaze" not in groups for groups in values["runner"]["obs_groups"].values())
