"""Data-parallel training under torchrun, on CPUs (gloo) and on GPUs (nccl)."""

from __future__ import annotations

from typing import Any, cast

import torch
from torch import distributed

from spin_rl.ranks import read_ranks


class Processes:
    """The processes of a run: their ranks, and the few numbers that they agree on beside the gradients."""

    def __init__(self, device: str) -> None:
        """Join the group that torchrun describes in the environment; a lone process needs none.

        Args:
            device: Device of this process; under torchrun "cpu" or its own GPU.

        Raises:
            ValueError: The device is not the one of this process's local rank.
        """
        ranks = read_ranks()
        self.world_size, self.rank, self.local_rank = ranks.world_size, ranks.rank, ranks.local_rank
        self.parallel, self.is_main = ranks.parallel, ranks.is_main
        self.joined = False
        if not self.parallel:
            return
        on_gpu = device != "cpu"
        if on_gpu and device != f"cuda:{self.local_rank}":
            raise ValueError(
                f"device={device} does not fit local rank {self.local_rank}: use cuda:{self.local_rank}."
            )
        if on_gpu:
            torch.cuda.set_device(self.local_rank)
        if not distributed.is_initialized():
            distributed.init_process_group(
                "nccl" if on_gpu else "gloo", rank=self.rank, world_size=self.world_size
            )
            self.joined = True
        # An int only stands for a group without this process; this one has all processes.
        self._host_group = cast(distributed.ProcessGroup, distributed.new_group(backend="gloo"))

    def any(self, *flags: bool) -> list[bool]:
        """Tell for each flag whether it is set in some process; the same answer everywhere."""
        if not self.parallel:
            return list(flags)
        values = torch.tensor(flags, dtype=torch.int32)
        distributed.all_reduce(values, distributed.ReduceOp.MAX, group=self._host_group)
        return [bool(value) for value in values.tolist()]

    def max(self, value: float) -> float:
        """Return the greatest of the processes' numbers."""
        if not self.parallel:
            return value
        greatest = torch.tensor(value, dtype=torch.float64)
        distributed.all_reduce(greatest, distributed.ReduceOp.MAX, group=self._host_group)
        return greatest.item()

    def gather(self, item: Any) -> list[Any]:
        """Collect one object of each process in the main one; the others get an empty list."""
        if not self.parallel:
            return [item]
        items: list[Any] | None = [None] * self.world_size if self.is_main else None
        distributed.gather_object(item, items, dst=0, group=self._host_group)
        return items or []

    def gather_all(self, item: Any) -> list[Any]:
        """Collect one small object of each process in all of them, in the order of their ranks."""
        if not self.parallel:
            return [item]
        items: list[Any] = [None] * self.world_size
        distributed.all_gather_object(items, item, group=self._host_group)
        return items

    def leave(self) -> None:
        """Leave the group, if it was joined here."""
        if self.joined:
            distributed.destroy_process_group()
            self.joined = False
