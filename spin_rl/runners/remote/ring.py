"""Which sequences a learner may use, while another process writes new ones: a ring of blocks."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RingConfig:
    """How old and how often used sequences may be.

    Attributes:
        blocks: Rollouts in memory, of which one is being written.
        max_staleness: Learner's iterations between the weights that acted and those that learn.
        max_reuse: Iterations that learn from one rollout; then the learner waits for the next.
    """

    blocks: int = 6
    max_staleness: int = 20
    max_reuse: int = 2

    def __post_init__(self) -> None:
        """Reject a ring in which someone would wait for ever."""
        for name, least in (("blocks", 3), ("max_staleness", 1), ("max_reuse", 1)):
            if getattr(self, name) < least:
                raise ValueError(f"asynchronous.{name} must be at least {least}, got {getattr(self, name)}")


@dataclass
class _Block:
    version: int
    uses: int = 0


class Ring:
    """The learner's book on the blocks that it holds; the others are the collector's.

    A block changes hands by a message, so nobody writes what another one reads.
    """

    def __init__(self, cfg: RingConfig) -> None:
        self.cfg = cfg
        self._held: dict[int, _Block] = {}  # in the order of arrival

    def add(self, slot: int, version: int) -> None:
        """Take a block over from the collector.

        Args:
            slot: Its place.
            version: Learner's iteration whose weights acted in it.
        """
        self._held[slot] = _Block(version)

    def choose(self, iteration: int) -> int | None:
        """Return the least used of the blocks that may be used now, the oldest of equals; None for none.

        Args:
            iteration: Iterations that the learner has done.
        """
        usable = [slot for slot, block in self._held.items() if self._is_usable(block, iteration)]
        return min(usable, key=lambda slot: self._held[slot].uses, default=None)

    def use(self, slot: int, iteration: int) -> tuple[int, int]:
        """Count a use; return the block's staleness and its number of uses."""
        block = self._held[slot]
        block.uses += 1
        return iteration - block.version, block.uses

    def release(self, iteration: int) -> list[int]:
        """Give up blocks that are of no use any more, and old used ones that the collector needs.

        Returns:
            Their places, for the collector.
        """
        given_up = [slot for slot, block in self._held.items() if not self._is_usable(block, iteration)]
        # One block to write into and a next one, so that the collector does not wait.
        excess = len(self._held) - len(given_up) - (self.cfg.blocks - 2)
        used = [slot for slot, block in self._held.items() if block.uses and slot not in given_up]
        given_up += used[: max(0, excess)]
        for slot in given_up:
            del self._held[slot]
        return given_up

    def _is_usable(self, block: _Block, iteration: int) -> bool:
        fresh = iteration - block.version <= self.cfg.max_staleness
        return fresh and block.uses < self.cfg.max_reuse
