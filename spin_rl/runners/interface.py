"""What training asks of an environment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import torch
from tensordict import TensorDict

from spin_rl.models import ScandotModel


@dataclass(frozen=True)
class Camera:
    """What of actions and observations belongs to an actuated camera.

    Attributes:
        actions: Actions that move it.
        columns: Columns of each observation group that tell where it is or how it moves.
    """

    actions: tuple[int, ...] = ()
    columns: Mapping[str, tuple[int, ...]] = field(default_factory=dict)

    @classmethod
    def of(cls, env: object) -> Camera:
        """Return the camera of an environment, an empty one if it names none."""
        return cls(getattr(env, "camera_actions", ()), getattr(env, "camera_columns", {}))

    def columns_of(self, model: ScandotModel) -> list[int]:
        """Return these columns' places among all that a model normalizes."""
        places, offset = [], 0
        for group, dim in model.flat_dims.items():
            places += [offset + column for column in self.columns.get(group, ())]
            offset += dim
        return places


class TrainingEnv(Protocol):
    """What the runner needs of an environment, beside rsl_rl's `VecEnv`.

    An environment whose `load_state_dict` also restores the running episodes sets `restores_episodes`;
    the policy's memory is then saved with it, and a resumed run goes on as if it had not been
    interrupted. One with an actuated camera has `camera_actions` and `camera_columns`, see `Camera`.
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

    def dump_non_finite(self, folder: Path) -> list[Path]:
        """Write the recent states of worlds that turned non-finite since the last call; return the files."""
        ...

    def state_dict(self) -> dict[str, Any]:
        """Return curriculum and random state as tensors, numbers and strings."""
        ...

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore what `state_dict` returned."""
        ...
