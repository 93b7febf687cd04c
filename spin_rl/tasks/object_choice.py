"""Which object the worlds of a task get: one by name, or any."""

from __future__ import annotations

from collections.abc import Sequence

import torch
import warp as wp

from spin_rl.scenes.objects import OBJECTS

ANY_OBJECT = "any"


def check_object(name: str) -> None:
    """Reject a value of `task.object` that is none.

    Raises:
        ValueError: Neither one of `objects.OBJECTS` nor "any".
    """
    if name != ANY_OBJECT and name not in OBJECTS:
        raise ValueError(f"task.object must be {ANY_OBJECT} or one of {', '.join(OBJECTS)}, got {name!r}")


class ObjectChoice:
    """Part of an environment with an object in every world; generators of scenes read `_kind_choice`."""

    def _allocate_choice(self, num_envs: int, name: str) -> None:
        """Allocate the kind of every world's next object, -1 for any, on the current device."""
        self._kind_choice = wp.full(num_envs, _index(name), dtype=wp.int32)

    def set_objects(self, kinds: Sequence[str]) -> None:
        """Fix the object of every world, from its next episode on.

        Args:
            kinds: One of `objects.OBJECTS` or "any" for each world.
        """
        indices = [_index(kind) for kind in kinds]
        wp.to_torch(self._kind_choice).copy_(torch.tensor(indices, dtype=torch.int32))


def _index(name: str) -> int:
    return -1 if name == ANY_OBJECT else OBJECTS.index(name)
