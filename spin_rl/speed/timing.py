"""Timing that machine drift does not bend: what is compared takes turns, block by block."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

NUM_BLOCKS = 7
_MIN_CALIBRATION_S = 0.02
_MAX_CALLS = 1 << 20


@dataclass(frozen=True)
class Timing:
    """How long a unit of work took.

    Attributes:
        blocks: Seconds per unit of work of every block, at least one.
    """

    blocks: tuple[float, ...]

    @property
    def median(self) -> float:
        """Median over the blocks [s]."""
        return statistics.median(self.blocks)

    def times_better_than(self, baseline: Timing) -> float:
        """How many times less time this took than the baseline, both measured in the same blocks.

        The median of the blocks' own ratios: a slow spell of the machine hits both sides of a ratio.

        Raises:
            ValueError: The numbers of blocks differ.
        """
        pairs = zip(self.blocks, baseline.blocks, strict=True)
        return statistics.median(theirs / own for own, theirs in pairs)


class Stopwatch:
    """Measures calls, on a GPU until it has finished them."""

    def __init__(
        self,
        synchronize: Callable[[], object] = lambda: None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        """Choose how to wait for the device, and the clock [s]."""
        self._synchronize = synchronize
        self._clock = clock

    def time(self, function: Callable[[], object], calls: int = 1) -> float:
        """Return the seconds that some calls in a row took."""
        self._synchronize()
        start = self._clock()
        for _ in range(calls):
            function()
        self._synchronize()
        return self._clock() - start


@dataclass(frozen=True)
class Subject:
    """Something to measure.

    Attributes:
        measure: Seconds that the given number of calls took; may prepare each call off the clock.
        work: Units of work in a call, such as worlds or environment steps.
    """

    measure: Callable[[int], float]
    work: float


def interleave(
    subjects: Mapping[str, Subject], seconds: float, num_blocks: int = NUM_BLOCKS
) -> dict[str, Timing]:
    """Measure subjects in turns.

    Every subject is warmed up, then measured once in every block, in an order that turns round from block to
    block.

    Args:
        subjects: What to measure, by name.
        seconds: Time to measure for, all subjects and blocks together; each gets an equal share.
        num_blocks: Blocks, at least one.

    Returns:
        The timing of every subject, by name.
    """
    share = seconds / (num_blocks * len(subjects))
    calls = {name: _calls_in(subject, share) for name, subject in subjects.items()}
    blocks: dict[str, list[float]] = {name: [] for name in subjects}
    order = list(subjects)
    for _ in range(num_blocks):
        for name in order:
            elapsed = subjects[name].measure(calls[name])
            blocks[name].append(elapsed / (calls[name] * subjects[name].work))
        order.reverse()
    return {name: Timing(tuple(values)) for name, values in blocks.items()}


def _calls_in(subject: Subject, seconds: float) -> int:
    """Warm up, and find how many calls fit in some seconds."""
    subject.measure(1)
    calls = 1
    while (elapsed := subject.measure(calls)) < min(_MIN_CALIBRATION_S, seconds) and calls < _MAX_CALLS:
        calls *= 2
    return max(1, round(calls * seconds / max(elapsed, 1e-9)))
