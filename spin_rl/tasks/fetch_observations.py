"""Observation groups of the fetch task: those of navigation and of picking, each policy reads its own.

proprio, goal, scandots, scandots_all, depth   see `observations.py`
hand, object_start, object, privileged         see `pick_observations.py`
stage  (num_envs, 1)  index into `fetch_state.STAGES`
"""

from __future__ import annotations

import torch
from tensordict import TensorDict

from spin_rl.tasks.observations import NavObservations
from spin_rl.tasks.pick_observations import PickObservations


class FetchObservations:
    """Computes the observation groups of both policies."""

    def __init__(self, nav: NavObservations, pick: PickObservations, stage: torch.Tensor) -> None:
        """Keep the two; proprio and images come from `nav`.

        Args:
            nav: Of the navigation task.
            pick: Of the pick task.
            stage: Stage of every world, a view, shape (num_envs,), int32.
        """
        self._nav, self._pick, self._stage = nav, pick, stage

    def compute(self) -> TensorDict:
        """Return new tensors of all groups."""
        groups = self._pick.compute()
        groups.update(self._nav.compute())
        groups["stage"] = self._stage[:, None].float()
        return groups

    def reseed(self, seed: int) -> None:
        """Restart the noise generators."""
        self._nav.reseed(seed)
        self._pick.reseed(seed + 1)

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Return the states of the noise generators."""
        pick = {f"pick_{name}": value for name, value in self._pick.state_dict().items()}
        return self._nav.state_dict() | pick

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore them."""
        self._nav.load_state_dict(state)
        self._pick.load_state_dict({name[5:]: value for name, value in state.items() if name[:5] == "pick_"})
