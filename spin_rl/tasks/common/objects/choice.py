"""Which object the worlds of a task get: one by name, any, or several in turn."""

from __future__ import annotations

from collections.abc import Sequence

import torch
import warp as wp

from spin_rl.scenes.objects.shapes import OBJECTS
from spin_rl.tasks.common.objects.config import ANY_OBJECT, object_names


class ObjectChoice:
    """Part of an environment with an object in every world; generators of scenes read `_kind_choice`."""

    def _allocate_choice(self, num_envs: int, choice: str) -> None:
        """Allocate the kind of every world's next object, -1 for any, on the current device."""
        names = object_names(choice)
        kinds = [_index(names[world % len(names)]) for world in range(num_envs)]
        self._kind_choice = wp.array(kinds, dtype=wp.int32)

    def set_objects(self, kinds: Sequence[str]) -> None:
        """Fix the object of every world, from its next episode on.

        Args:
            kinds: One of `objects.OBJECTS` or "any" for each world.
        """
        indices = [_index(kind) for kind in kinds]
        wp.to_torch(self._kind_choice).copy_(torch.tensor(indices, dtype=torch.int32))


def _index(name: str) -> int:
    return -1 if name == ANY_OBJECT else OBJECTS.index(name)
