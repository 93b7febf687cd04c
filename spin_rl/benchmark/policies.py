"""What can be evaluated: policy files, and two that learned nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from tensordict import TensorDict

from spin_rl import robot
from spin_rl.config import ConfigError
from spin_rl.policy import PolicyFactory
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


def open_policy(name: str) -> tuple[PolicyFactory, dict[str, Any]]:
    """Find a policy.

    Args:
        name: Shipped policy, checkpoint, run directory, .safetensors file, `zero` or `random`.

    Returns:
        A function that makes the policy for an environment, and the configuration that it was trained with
        (empty for `zero` and `random`).

    Raises:
        ConfigError: There is no such policy, or it is damaged.
    """
    if name == "zero":
        return lambda obs, device: ZeroPolicy(), {}
    if name == "random":
        return lambda obs, device: RandomPolicy(device), {}
    try:
        metadata = policy_file.read_policy(name)[1]
    except FileNotFoundError as error:
        untrained = "" if Path(name).exists() else f" Always there: {', '.join(UNTRAINED)}."
        raise ConfigError(f"policy: {error}{untrained}") from None
    except ValueError as error:
        raise ConfigError(f"policy: {error}") from None
    return (
        lambda obs, device: policy_file.load_policy(name, obs, device),
        metadata["config"],
    )
