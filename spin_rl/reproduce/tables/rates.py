"""Success rates of trainings that were measured in the same scenes, and their differences."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spin_rl.benchmark.metrics import paired_interval, wilson_interval
from spin_rl.config import ConfigError

_SUCCESS = "s"
"""Letter of a success in the `outcomes` of a row."""


@dataclass(frozen=True)
class Rate:
    """Which scenes were a success.

    Attributes:
        wins: For every training, shape (trainings, scenes), of zeros and ones.
    """

    wins: np.ndarray

    @classmethod
    def of(cls, trainings: Iterable[Iterable[Mapping[str, Any]]]) -> Rate:
        """Of the rows of benchmarks of each training, which have the same scenes.

        Raises:
            ConfigError: The numbers of episodes differ, or a row does not tell its outcomes.
        """
        wins = [np.concatenate([_wins(row) for row in rows]) for rows in trainings]
        if len({len(one) for one in wins}) > 1:
            raise ConfigError("table: trainings of a row were measured in other scenes: run them again")
        return cls(np.stack(wins))

    @property
    def value(self) -> float:
        """The rate, over all trainings."""
        return float(self.wins.mean())

    @property
    def each(self) -> list[float]:
        """That of each training."""
        return self.wins.mean(axis=1).tolist()

    @property
    def episodes(self) -> int:
        """Of all trainings together."""
        return self.wins.size

    @property
    def interval(self) -> tuple[float, float]:
        """Its 95 % interval, which covers the choice of scenes and not that of trainings.

        Wilson's for as many independent episodes as have the variance of the scenes' means: two trainings in
        one scene are less than two scenes (the design effect of Kish 1965).
        """
        trainings, scenes = self.wins.shape
        rate, variance = self.value, float(self.wins.mean(axis=0).var())
        independent = scenes * rate * (1.0 - rate) / variance if variance > 0.0 else scenes
        independent = min(max(independent, scenes), scenes * trainings)
        return wilson_interval(rate * independent, independent)

    def text(self) -> str:
        """Such as `0.93 (0.90-0.95)`."""
        return rate_text(self.value, self.interval)

    def each_text(self) -> str:
        """Such as `0.95 0.91`."""
        return " ".join(f"{rate:.2f}" for rate in self.each)


def rate_text(value: float, interval: tuple[float, float]) -> str:
    """A rate with its interval, such as `0.93 (0.90-0.95)`."""
    return f"{value:.2f} ({interval[0]:.2f}-{interval[1]:.2f})"


def difference(one: Rate, other: Rate) -> tuple[float, float, float]:
    """Difference of two rates in the same scenes, and its 95 % interval (`metrics.paired_interval`).

    Returns:
        `one` less `other`, and the ends of the interval.

    Raises:
        ConfigError: The numbers of scenes differ.
    """
    if one.wins.shape[1] != other.wins.shape[1]:
        raise ConfigError("table: rows were measured in other scenes: run them again")
    scenes = one.wins.mean(axis=0) - other.wins.mean(axis=0)
    return (float(scenes.mean()), *paired_interval(scenes))


def _wins(row: Mapping[str, Any]) -> np.ndarray:
    """Which episodes of a row were a success, shape (episodes,)."""
    if "outcomes" in row:
        return np.array([letter == _SUCCESS for letter in row["outcomes"]])
    if row["success_rate"] in (0.0, 1.0):
        return np.full(row["episodes"], bool(row["success_rate"]))
    raise ConfigError("table: a row does not tell which episodes were a success: measure it again")


def spread(one: Sequence[float], other: Sequence[float]) -> tuple[float, float] | None:
    """Smallest and largest difference between a training of one and of the other; None with one of each."""
    pairs = [a - b for a in one for b in other]
    return (min(pairs), max(pairs)) if len(pairs) > 1 else None
