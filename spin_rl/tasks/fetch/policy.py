"""One policy out of two: navigation for driving, picking for grasping."""

from __future__ import annotations

import torch
from tensordict import TensorDict

from spin_rl.policy import Policy
from spin_rl.tasks.fetch.config import STAGES


class FetchPolicy:
    """Picks every world's action by its stage; a policy's memory is empty when its stage begins.

    Scripted stages ignore the action.
    """

    def __init__(self, nav: Policy, pick: Policy) -> None:
        """Keep the two policies; both are evaluated in all worlds."""
        self._nav, self._pick = nav, pick
        self._stage: torch.Tensor | None = None

    def __call__(self, obs: TensorDict) -> torch.Tensor:
        """Return actions for observations of `FetchEnv`, shape (num_envs, 10)."""
        stage = obs["stage"][:, 0]
        if self._stage is not None:
            entered = stage != self._stage
            self._nav.reset(entered)
            self._pick.reset(entered)
        self._stage = stage
        picks = stage == STAGES.index("pick")
        return torch.where(picks[:, None], self._pick(obs), self._nav(obs))

    def reset(self, dones: torch.Tensor | None = None) -> None:
        """Clear the memory of the worlds in a mask (num_envs,), or of all."""
        self._nav.reset(dones)
        self._pick.reset(dones)
        if dones is None:
            self._stage = None
