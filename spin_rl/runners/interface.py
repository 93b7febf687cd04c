"""What training asks of an environment."""

from __future__ import annotations

from typing import Any, Protocol

import torch
from tensordict import TensorDict


class TrainingEnv(Protocol):
    """What the runner needs of an environment, beside rsl_rl's `VecEnv`.

    An environment whose `load_state_dict` also restores the running episodes sets `restores_episodes`;
    the policy's memory is then saved with it, and a resumed run goes on as if it had not been
    interrupted.
    """

    num_envs: int
    num_actions: int

    def get_observations(self) -> TensorDict:
        """Return the current observations, groups of shape (num_envs, dim)."""
        ...

    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict]:
        """Take actions (num_envs, num_actions); return observations, rewards, dones and extras."""
        ...

    def episode_stats(self) -> dict[str, float]:
        """Read and clear the statistics of the episodes that ended: at least "episodes" and their means."""
        ...

    def state_dict(self) -> dict[str, Any]:
        """Return curriculum and random state as tensors, numbers and strings."""
        ...

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore what `state_dict` returned."""
        ...
