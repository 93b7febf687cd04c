"""Policies that learned nothing, to compare with."""

from __future__ import annotations

import torch
from tensordict import TensorDict

from spin_rl import robot


class ZeroPolicy:
    """Stands still."""

    def __call__(self, obs: TensorDict) -> torch.Tensor:
        """Return zeros, shape (num_envs, 10)."""
        return torch.zeros(obs.batch_size[0], len(robot.ACTIONS), device=obs.device)

    def reset(self, dones: torch.Tensor | None = None) -> None:
        """Do nothing: there is no state."""


class RandomPolicy(ZeroPolicy):
    """Draws every action uniformly from [-1, 1]."""

    def __init__(self, device: str, seed: int = 0) -> None:
        self._rng = torch.Generator(device).manual_seed(seed)

    def __call__(self, obs: TensorDict) -> torch.Tensor:
        """Return actions, shape (num_envs, 10)."""
        shape = (obs.batch_size[0], len(robot.ACTIONS))
        return torch.rand(shape, generator=self._rng, device=self._rng.device) * 2.0 - 1.0
