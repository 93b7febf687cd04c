"""What can be evaluated: policy files, and two that learned nothing."""

from __future__ import annotations

from typing import Any

import torch
from tensordict import TensorDict

from spin_rl import robot
from spin_rl.benchmark.reach import PolicyFactory
from spin_rl.runners import policy_file

UNTRAINED = ("zero", "random")


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


def factory(name: str) -> PolicyFactory:
    """Find a policy and return a function that makes it for an environment.

    Args:
        name: Shipped policy, checkpoint, run directory, .safetensors file, `zero` or `random`.

    Raises:
        ConfigError: There is no such policy.
    """
    if name == "zero":
        return lambda obs, device: ZeroPolicy()
    if name == "random":
        return lambda obs, device: RandomPolicy(device)
    policy_file.find(name)
    return lambda obs, device: policy_file.load_policy(name, obs, device)


def training_config(name: str) -> dict[str, Any]:
    """Return the configuration that a policy was trained with, empty for `zero` and `random`."""
    if name in UNTRAINED:
        return {}
    return policy_file.read_metadata(name).get("config", {})
