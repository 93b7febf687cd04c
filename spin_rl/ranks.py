"""Which of the processes that torchrun started this one is."""

from __future__ import annotations

import os
from dataclasses import dataclass


@dataclass(frozen=True)
class Ranks:
    """Which of the processes of a run this one is.

    Attributes:
        world_size: How many there are; alone, 1.
        rank: Its number.
        local_rank: Its number on this machine.
    """

    world_size: int = 1
    rank: int = 0
    local_rank: int = 0

    @property
    def parallel(self) -> bool:
        """Whether there is more than one process."""
        return self.world_size > 1

    @property
    def is_main(self) -> bool:
        """Whether this process writes files and shows progress."""
        return self.rank == 0


def read_ranks() -> Ranks:
    """Read what torchrun says in the environment; ranks mean something only with WORLD_SIZE above 1.

    Raises:
        ValueError: That is nonsense; one line that names the variable.
    """
    world_size = _read("WORLD_SIZE", 1)
    if world_size < 1:
        raise ValueError(f"WORLD_SIZE: expected at least 1 in the environment, got {world_size}")
    if world_size == 1:
        return Ranks()
    ranks = Ranks(world_size, _read("RANK", None), _read("LOCAL_RANK", None))
    for name, rank in (("RANK", ranks.rank), ("LOCAL_RANK", ranks.local_rank)):
        if not 0 <= rank < world_size:
            raise ValueError(f"{name}: expected 0 to {world_size - 1} in the environment, got {rank}")
    return ranks


def _read(name: str, default: int | None) -> int:
    text = os.environ.get(name)
    if text is None and default is not None:
        return default
    if text is None or not text.isdecimal():
        raise ValueError(f"{name}: expected a whole number in the environment, got {text!r}")
    return int(text)
