"""The peer of the training update: rsl_rl's own PPO and models on the same rollout."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from typing import Any

import torch
from rsl_rl.algorithms import PPO
from rsl_rl.models import MLPModel, RNNModel
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict

from spin_rl.models import ScandotModel, ScandotRecurrentModel
from spin_rl.runners.ppo import algorithm
from spin_rl.runners.ppo.storage import SequenceStorage


class RslRlPeer:
    """rsl_rl's PPO with models as large as the trained ones, on flat observations of the same groups.

    Recurrent models are rsl_rl's RNNModel with as many units; scandots go in flat, since rsl_rl has no
    PointNet. Where the trained model has no hidden layer after its LSTM, rsl_rl's gets a small one, of one
    unit an action: it requires one.
    """

    def __init__(self, ours: algorithm.PPO, groups: dict[str, list[str]], cfg: dict[str, Any]) -> None:
        """Build the peer and copy the rollout that the trained algorithm holds.

        Args:
            ours: The trained algorithm, after a rollout.
            groups: Observation groups of "actor" and "critic".
            cfg: Section `runner` of the configuration: number of epochs and minibatches and so on.
        """
        self._groups = groups
        rollout = ours.storage
        obs = self._flat(rollout.observations)
        num_actions = rollout.actions.shape[-1]
        own = {name: [name] for name in groups}
        std = {"class_name": "rsl_rl.modules.distribution:GaussianDistribution", "init_std": 0.5}
        actor = _model(ours.actor, cfg["actor"], obs[0], own, "actor", num_actions, num_actions, std)
        critic = _model(ours.critic, cfg["critic"], obs[0], own, "critic", 1, num_actions, None)
        known = inspect.signature(PPO).parameters
        settings = {key: value for key, value in cfg["algorithm"].items() if key in known}
        device = str(ours.device)
        storage = RolloutStorage("rl", rollout.num_envs, rollout.num_steps, obs[0], [num_actions], device)
        self._ppo = PPO(actor, critic, storage, device=device, **settings)
        self._copy(rollout, obs)

    def update(self) -> None:
        """Learn from the copied rollout, all epochs."""
        self._ppo.storage.step = self._ppo.storage.num_transitions_per_env
        self._ppo.update()

    def _flat(self, observations: TensorDict) -> TensorDict:
        flat = {
            name: torch.cat([observations[group] for group in members], dim=-1)
            for name, members in self._groups.items()
        }
        return TensorDict(flat, batch_size=observations.batch_size)

    @torch.no_grad()
    def _copy(self, rollout: SequenceStorage, obs: TensorDict) -> None:
        """Fill rsl_rl's storage by acting on the same observations, with the same ends of episodes."""
        for step in range(rollout.num_steps):
            self._ppo.act(obs[step])
            self._ppo.process_env_step(obs[step], rollout.rewards[step], rollout.dones[step].long(), {})
        self._ppo.compute_returns(obs[-1])


def _model(
    like: ScandotModel,
    cfg: dict[str, Any],
    obs: TensorDict,
    groups: dict[str, list[str]],
    name: str,
    output_dim: int,
    least_hidden: int,
    distribution: dict[str, Any] | None,
) -> MLPModel:
    hidden: Sequence[int] = cfg.get("hidden_dims") or [least_hidden]
    shared = {"hidden_dims": hidden, "obs_normalization": True, "distribution_cfg": distribution}
    if isinstance(like, ScandotRecurrentModel):
        return RNNModel(obs, groups, name, output_dim, rnn_hidden_dim=like.rnn_hidden_dim, **shared)
    return MLPModel(obs, groups, name, output_dim, **shared)
