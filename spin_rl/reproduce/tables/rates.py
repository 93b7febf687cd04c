"""Success rates of several trainings together, and their differences."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from spin_rl.benchmark.metrics import wilson_interval


@dataclass(frozen=True)
class Rate:
    """So many of so many episodes."""

    successes: int
    episodes: int

    @classmethod
    def of(cls, rows: Iterable[Mapping[str, Any]]) -> Rate:
        """Pool rows of benchmarks, with `success_rate` and `episodes`."""
        rows = list(rows)
        return cls(
            sum(round(row["success_rate"] * row["episodes"]) for row in rows),
            sum(row["episodes"] for row in rows),
        )

    @property
    def value(self) -> float:
        """The rate."""
        return self.successes / self.episodes

    @property
    def interval(self) -> tuple[float, float]:
        """Its 95 % Wilson interval, which covers the choice of episodes and not that of trainings."""
        return wilson_interval(self.successes, self.episodes)

    def text(self) -> str:
        """Such as `0.93 (0.90-0.95)`."""
        low, high = self.interval
        return f"{self.value:.2f} ({low:.2f}-{high:.2f})"


def difference(one: Rate, other: Rate) -> tuple[float, float, float]:
    """Difference of two rates and its 95 % interval by Newcombe 1998 (method 10, of Wilson's intervals).

    Returns:
        `one` less `other`, and the ends of the interval.
    """
    mean = one.value - other.value
    (low, high), (other_low, other_high) = one.interval, other.interval
    down = math.hypot(one.value - low, other_high - other.value)
    up = math.hypot(high - one.value, other.value - other_low)
    return mean, mean - down, mean + up
