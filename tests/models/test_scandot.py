"""Actor and critic models on observations of every shape that training gives them."""

import pytest
import torch
from tensordict import TensorDict

from spin_rl.models import ScandotModel, ScandotRecurrentModel

ENVS, STEPS = 5, 6
DISTRIBUTION = {"class_name": "rsl_rl.modules:GaussianDistribution", "init_std": 0.5}
GROUPS = {"actor": ["proprio", "goal", "scandots"], "critic": ["proprio", "goal", "scandots_all"]}


def make_obs(*shape):
    def tokens():
        values = torch.randn(*shape, 4, 32)
        values[..., 24:] = (torch.rand(*shape, 4, 8) < 0.1).float()
        return values.flatten(-2)

    groups = {"proprio": 3.0 + 2.0 * torch.randn(*shape, 7), "goal": torch.randn(*shape, 3)}
    return TensorDict(groups | {"scandots": tokens(), "scandots_all": tokens()}, batch_size=shape)


def make_actor(**settings):
    torch.manual_seed(0)
    settings = {"rnn_hidden_dim": 8, "distribution_cfg": DISTRIBUTION} | settings
    return ScandotRecurrentModel(make_obs(ENVS), GROUPS, "actor", 3, **settings)


@pytest.mark.parametrize("encoder", ["pointnet", "concat"])
@pytest.mark.parametrize("hidden_dims", [(), (16,)])
def test_recurrent_rollout_matches_its_sequence(encoder, hidden_dims):
    actor = make_actor(encoder=encoder, hidden_dims=hidden_dims)
    obs, resets = make_obs(STEPS, ENVS), torch.rand(STEPS, ENVS) < 0.3
    resets[0] = False
    zeros = torch.zeros(1, ENVS, 8)
    outputs = []
    with torch.no_grad():
        for step in range(STEPS):
            actor.reset(resets[step])
            outputs.append(actor(obs[step]))
        sequence = actor(obs, hidden_state=(zeros, zeros), resets=resets)
    torch.testing.assert_close(torch.stack(outputs), sequence)


def test_feed_forward_model_treats_steps_alike():
    critic = ScandotModel(make_obs(ENVS), GROUPS, "critic", 1, hidden_dims=(16,))
    obs = make_obs(STEPS, ENVS)
    with torch.no_grad():
        expected = torch.stack([critic(obs[step]) for step in range(STEPS)])
        torch.testing.assert_close(critic(obs, resets=torch.ones(STEPS, ENVS, dtype=torch.bool)), expected)


def test_models_read_only_their_groups():
    actor, obs = make_actor(), make_obs(ENVS)
    expected = actor(obs)
    actor.reset()
    obs["scandots_all"] += 1.0
    torch.testing.assert_close(actor(obs), expected)
    actor.reset()
    obs["scandots"] += 1.0
    assert not torch.allclose(actor(obs), expected)


def test_normalization_covers_the_flat_groups_only():
    actor, obs = make_actor(), make_obs(2000)
    actor.train()
    actor.update_normalization(obs)
    assert actor.obs_normalizer._mean.shape == (1, 10)
    encoded = actor.encode(obs)
    assert encoded.shape == (2000, 10 + 16)
    torch.testing.assert_close(encoded[:, :7].mean(0), torch.zeros(7), atol=1e-3, rtol=0.0)
    torch.testing.assert_close(encoded[:, :7].std(0), torch.ones(7), atol=2e-2, rtol=0.0)
    tokens = obs["scandots"].unflatten(-1, (-1, 32))
    torch.testing.assert_close(encoded[:, 10:], actor.encoders["scandots"](tokens))


def test_samples_follow_the_distribution():
    actor, obs = make_actor(), make_obs(ENVS)
    mean = actor(obs)
    actor.reset()
    samples = []
    for _ in range(2000):
        samples.append(actor(obs, stochastic_output=True).detach())
        actor.reset()
    samples = torch.stack(samples)
    torch.testing.assert_close(samples.mean(0), mean, atol=0.06, rtol=0.0)
    torch.testing.assert_close(samples.std(0), torch.full((ENVS, 3), 0.5), atol=0.05, rtol=0.0)


@pytest.mark.parametrize(
    ("groups", "settings", "message"),
    [
        ({"actor": ["scandots"]}, {}, "beside the scandots"),
        ({"actor": ["proprio", "scandots_odd"]}, {}, "scandots_odd"),
    ],
)
def test_impossible_settings_are_named(groups, settings, message):
    obs = make_obs(ENVS)
    obs["scandots_odd"] = torch.zeros(ENVS, 33)
    with pytest.raises(ValueError, match=message):
        ScandotRecurrentModel(obs, groups, "actor", 3, **settings)


def test_sequences_need_their_state_and_resets():
    actor, obs = make_actor(), make_obs(STEPS, ENVS)
    zeros = torch.zeros(1, ENVS, 8)
    with pytest.raises(ValueError, match="hidden state"):
        actor(obs, resets=torch.zeros(STEPS, ENVS, dtype=torch.bool))
    with pytest.raises(ValueError, match="episode starts"):
        actor(obs, hidden_state=(zeros, zeros))
