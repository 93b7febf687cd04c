"""A policy whose camera acts as in training: its actions are drawn, all others are as in evaluation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from tensordict import TensorDict

from spin_rl.config import ConfigError
from spin_rl.policy import Policy


def check_draws(policy: Policy) -> None:
    """Reject a policy whose actions cannot be drawn.

    Raises:
        ConfigError: It has no distribution.
    """
    if getattr(policy, "distribution", None) is None:
        raise ConfigError("camera_analysis.sampled: this policy draws no actions; take one of spin-train")


class SampledCamera:
    """Adds the noise of exploration to what the camera is told, and to nothing else.

    What is drawn follows from the seed alone, so that a measurement can be repeated.
    """

    def __init__(self, policy: Policy, actions: Sequence[int], seed: int = 0) -> None:
        """Wrap a policy.

        Args:
            policy: Must have a distribution of actions, as what was trained by PPO has.
            actions: Indices of the camera's.
            seed: Of what is drawn.

        Raises:
            ConfigError: The policy has no distribution.
        """
        check_draws(policy)
        self._policy: Any = policy
        self._actions = list(actions)
        self._seed = seed
        self._generator: torch.Generator | None = None

    def __call__(self, obs: TensorDict) -> torch.Tensor:
        """Return actions, shape (num_envs, num_actions)."""
        self._policy(obs, stochastic_output=True)  # for its distribution; what it draws itself has no seed
        mean, std = self._policy.distribution.mean, self._policy.distribution.std
        if self._generator is None:
            self._generator = torch.Generator(mean.device).manual_seed(self._seed)
        noise = torch.randn(
            (len(mean), len(self._actions)), generator=self._generator, device=mean.device, dtype=mean.dtype
        )
        drawn = mean.clone()
        drawn[:, self._actions] += noise * std[:, self._actions]
        return drawn

    def reset(self, dones: torch.Tensor | None = None) -> None:
        """Clear the policy's memory of the worlds in a mask (num_envs,), or of all."""
        self._policy.reset(dones)
