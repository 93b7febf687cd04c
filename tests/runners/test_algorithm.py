"""The update against rsl_rl's own, and what it does beyond it."""

import math
from itertools import chain

import numpy as np
import pytest
import rsl_rl.algorithms
import torch
from fake_env import FakeEnv, make_config
from rsl_rl.storage import RolloutStorage

from spin_rl.runners import PPO


def make_algorithm(env, critic="feed_forward", num_steps=8, **settings) -> PPO:
    torch.manual_seed(0)
    cfg = make_config(critic, **settings) | {"num_steps_per_env": num_steps, "multi_gpu": None}
    algorithm = PPO.construct_algorithm(env.get_observations(), env, cfg, "cpu")
    algorithm.train_mode()
    return algorithm


def collect(algorithm, env):
    """One rollout; returns what an on-looker with copies saw."""
    seen = []
    obs = env.get_observations()
    with torch.no_grad():
        for _ in range(algorithm.storage.num_steps):
            before = obs.clone()
            actions = algorithm.act(obs)
            obs, rewards, dones, extras = env.step(actions)
            algorithm.process_env_step(obs, rewards, dones, extras)
            seen.append((before, actions, rewards.clone(), dones.clone(), extras["time_outs"].clone()))
        algorithm.compute_returns(obs)
    return seen, obs.clone()


@pytest.mark.parametrize("critic", ["feed_forward", "recurrent"])
def test_update_equals_rsl_rl(critic):
    """One update, of one minibatch so that the order of environments does not matter."""
    settings = {"num_mini_batches": 1, "schedule": "fixed", "num_learning_epochs": 3, "entropy_coef": 0.01}
    env = FakeEnv()
    ours, theirs = make_algorithm(env, critic, **settings), make_algorithm(env, critic, **settings)
    storage = RolloutStorage("rl", env.num_envs, 8, env.get_observations(), [env.num_actions])
    del settings["schedule"]
    theirs = rsl_rl.algorithms.PPO(
        theirs.actor, theirs.critic, storage, gamma=0.95, learning_rate=1e-3, schedule="fixed", **settings
    )
    episode_ends = 0
    for rollout in range(2):  # the second starts with a state
        seen, last_obs = collect(ours, env)
        with torch.no_grad():
            for before, actions, rewards, dones, time_outs in seen:
                theirs.act(before)
                theirs.transition.actions = actions  # the same sample
                theirs.transition.actions_log_prob = theirs.actor.get_output_log_prob(actions)
                theirs.process_env_step(last_obs, rewards, dones, {"time_outs": time_outs})
            theirs.compute_returns(last_obs)
        episode_ends += sum(int(dones.sum()) for _, _, _, dones, _ in seen)
        torch.testing.assert_close(ours.storage.returns, storage.returns.squeeze(-1))
        # Ours are normalized by the variance of all samples, theirs by the estimate that divides by one less.
        scale = math.sqrt(96 / 95)
        torch.testing.assert_close(ours.storage.advantages, scale * storage.advantages.squeeze(-1))
        ours.storage.advantages /= scale
        ours_losses, their_losses = ours.update(), theirs.update()
        for name in ("value", "surrogate", "entropy"):
            assert ours_losses[name] == pytest.approx(their_losses[name], rel=1e-3, abs=1e-5), (rollout, name)
    assert episode_ends > 0
    for own, other in zip(ours.actor.state_dict().values(), theirs.actor.state_dict().values(), strict=True):
        torch.testing.assert_close(own, other, rtol=1e-3, atol=2e-5)
    for own, other in zip(
        ours.critic.state_dict().values(), theirs.critic.state_dict().values(), strict=True
    ):
        torch.testing.assert_close(own, other, rtol=1e-3, atol=2e-5)


def test_storage_keeps_observations_that_the_environment_overwrites():
    env = FakeEnv()
    algorithm = make_algorithm(env)
    seen, _ = collect(algorithm, env)
    for step, (before, *_) in enumerate(seen):
        for name, values in algorithm.storage.observations.items():
            torch.testing.assert_close(values[step], before[name])


def test_advantages_match_numpy():
    env = FakeEnv()
    algorithm = make_algorithm(env, num_steps=25)
    seen, last_obs = collect(algorithm, env)
    rewards, dones, late = (np.stack([item[i].numpy() for item in seen]).astype(float) for i in (2, 3, 4))
    assert late.any() and (dones > late).any()
    values = algorithm.storage.values.numpy()
    with torch.no_grad():
        following = np.concatenate([values[1:], algorithm.critic(last_obs).numpy().T])
    rewards += 0.95 * late * values
    advantages = np.zeros_like(rewards)
    for env_id in range(env.num_envs):
        for start in range(25):
            weight = 1.0
            for step in range(start, 25):
                go_on = 1.0 - dones[step, env_id]
                delta = rewards[step, env_id] + 0.95 * go_on * following[step, env_id] - values[step, env_id]
                advantages[start, env_id] += weight * delta
                weight *= 0.95 * 0.95 * go_on
    expected = (advantages - advantages.mean()) / advantages.std()
    np.testing.assert_allclose(algorithm.storage.advantages.numpy(), expected, atol=1e-4)


def test_minibatches_hold_every_environment_once():
    env = FakeEnv(num_envs=11)
    algorithm = make_algorithm(env)
    collect(algorithm, env)
    algorithm.storage.actions[:] = torch.arange(11.0).view(1, -1, 1)
    batches = algorithm.storage.mini_batches(3)
    ids = [batch.actions[0, :, 0].tolist() for batch in batches]
    assert sorted(chain(*ids)) == list(range(11))
    assert [len(part) for part in ids] == [4, 4, 3]
    dones = algorithm.storage.dones
    for batch, part in zip(batches, ids, strict=True):
        index = torch.tensor(part).long()
        assert not batch.resets[0].any()
        torch.testing.assert_close(batch.resets[1:], dones[:-1, index])
        torch.testing.assert_close(batch.states[0][0][0], algorithm.storage.states[0][0][0, index])


def test_step_with_bad_gradients_is_left_out():
    """One environment's poisoned target spoils the minibatch that holds it, and nothing else."""
    env = FakeEnv()
    algorithm = make_algorithm(env, num_learning_epochs=2, num_mini_batches=3)
    collect(algorithm, env)
    algorithm.storage.advantages[2, 5] = torch.inf
    losses = algorithm.update()
    assert losses["skipped_steps"] == 2.0
    assert math.isfinite(losses["surrogate"])
    assert all(p.isfinite().all() for p in algorithm.actor.parameters())


def test_bad_rollout_changes_nothing_and_bad_rollouts_end_training():
    env = FakeEnv(poisoned_steps=(3, 8, 16, 24))
    algorithm = make_algorithm(env)
    collect(algorithm, env)
    before = [tensor.clone() for tensor in algorithm.actor.state_dict().values()]
    assert algorithm.update()["skipped_steps"] == 6.0
    for old, new in zip(before, algorithm.actor.state_dict().values(), strict=True):
        torch.testing.assert_close(new, old, rtol=0.0, atol=0.0)
    collect(algorithm, env)
    algorithm.update()
    collect(algorithm, env)
    with pytest.raises(FloatingPointError, match="not finite"):
        algorithm.update()


def test_standard_deviation_stays_in_range():
    env = FakeEnv()
    algorithm = make_algorithm(env)
    collect(algorithm, env)
    with torch.no_grad():
        algorithm.actor.distribution.std_param.fill_(-3.0)
    algorithm.update()
    assert (algorithm.actor.distribution.std_param >= 0.1).all()


@pytest.mark.parametrize(("schedule", "expected"), [("linear", 5.05e-4), ("fixed", 1e-3)])
def test_learning_rate_over_the_run(schedule, expected):
    algorithm = make_algorithm(FakeEnv(), schedule=schedule)
    algorithm.set_progress(0.5)
    assert algorithm.optimizer.param_groups[0]["lr"] == pytest.approx(expected)


@pytest.mark.parametrize(("desired_kl", "direction"), [(1e-9, -1), (1e6, 1)])
def test_adaptive_learning_rate_follows_the_divergence(desired_kl, direction):
    env = FakeEnv()
    algorithm = make_algorithm(env, desired_kl=desired_kl, learning_rate=1e-4, min_learning_rate=1e-8)
    collect(algorithm, env)
    algorithm.update()
    changes = direction * math.log(algorithm.learning_rate / 1e-4, 1.5)
    # Six minibatches; the first sees the policy that collected, and may find no divergence at all.
    assert round(changes, 6) in (5.0, 6.0)
