"""What whoever runs a policy asks of it, be it to measure it or to show it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import torch
    from tensordict import TensorDict


class Policy(Protocol):
    """Turns observations into actions, world by world."""

    def __call__(self, obs: TensorDict) -> torch.Tensor:
        """Return deterministic actions in [-1, 1], shape (num_envs, 10)."""
        ...

    def reset(self, dones: torch.Tensor | None = None) -> None:
        """Clear the recurrent state of the worlds in a mask (num_envs,), or of all."""
        ...


PolicyFactory = Callable[["TensorDict", str], Policy]
"""Makes a policy for the observations and device of an environment."""
