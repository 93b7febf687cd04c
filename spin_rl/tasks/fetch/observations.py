"""Observation groups of the fetch task: those of navigation and of picking, each policy reads its own.

proprio, goal, scandots, scandots_all, scandots_map, depth   see `nav/observations.py`
hand, object_start, object, object_at_start, privileged  see `pick/observations.py`
hand_in_image  likewise, in the pick policy's range of depths
stage  (num_envs, 1)  index into `state.STAGES`

Each policy reads depths in the range that it was trained with: images are scaled for picking in that stage,
for navigation in all others. Tokens of scandots are in the order of the slots; that of the table may be left
out, after which they are those of navigation.
"""

from __future__ import annotations

import torch
from tensordict import TensorDict

from spin_rl.tasks.common.depth import DepthImages
from spin_rl.tasks.fetch.config import STAGES
from spin_rl.tasks.nav.observations import NavObservations
from spin_rl.tasks.pick.observations import PickObservations
from spin_rl.warp_kernels.tokens import TOKEN_SIZE


class FetchObservations:
    """Computes the observation groups of both policies."""

    def __init__(
        self,
        nav: NavObservations,
        pick: PickObservations,
        stage: torch.Tensor,
        images: DepthImages | None = None,
        pick_range: tuple[float, float] | None = None,
        told: torch.Tensor | None = None,
    ) -> None:
        """Keep the two; proprio and images come from `nav`.

        Args:
            nav: Of the navigation task.
            pick: Of the pick task.
            stage: Stage of every world, a view, shape (num_envs,), int32.
            images: The images that `nav` observes, if there are any.
            pick_range: Depths that the pick policy sees as 0 and as 255 [m]; None for those of `nav`.
            told: Slots that scandots tell of, shape (k,), int64; None for all.
        """
        self._told = told
        self._nav, self._pick, self._stage = nav, pick, stage
        self._images, self._pick_range = images, pick_range

    def compute(self) -> TensorDict:
        """Return new tensors of all groups."""
        groups = self._pick.compute()
        groups.update(self._nav.compute())
        if self._told is not None:
            for name in {"scandots", "scandots_all", "scandots_map"} & set(groups.keys()):
                tokens = groups[name].unflatten(-1, (-1, TOKEN_SIZE))
                groups[name] = tokens.index_select(1, self._told).flatten(1)
        groups["stage"] = self._stage[:, None].float()
        if self._images is not None:
            groups["hand_in_image"] = self._images.locate(self._pick.grasp_centre, self._pick_range)
            if self._pick_range is not None:
                picks = (self._stage == STAGES.index("pick"))[:, None]
                groups["depth"] = torch.where(picks, self._images.observe(self._pick_range), groups["depth"])
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
