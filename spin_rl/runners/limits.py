"""How long a run goes on."""

from __future__ import annotations

import math
from dataclasses import dataclass


class Interrupted(Exception):
    """What was waited for did not come before the run had to end."""


@dataclass
class Limits:
    """Iterations and wall time of one call of `train`.

    Attributes:
        max_iterations: Iterations of the whole run, those before this call included.
        max_minutes: Wall time of this call [min]; None for no limit.
        first_iteration: Iterations done before this call.
        elapsed_s: Wall time since this call began [s].
    """

    max_iterations: int
    max_minutes: float | None
    first_iteration: int
    elapsed_s: float = 0.0
    _last_s: float = 0.0

    def __post_init__(self) -> None:
        if self.max_iterations < 1:
            raise ValueError(f"max_iterations must be a positive integer, not {self.max_iterations}.")
        if self.max_minutes is not None and not 0.0 < self.max_minutes < math.inf:
            raise ValueError(f"max_minutes must be a positive number or none, not {self.max_minutes}.")

    def advance(self, elapsed_s: float) -> None:
        """Take note of the time at the end of an iteration."""
        self._last_s, self.elapsed_s = elapsed_s - self.elapsed_s, elapsed_s

    def progress(self, iteration: int) -> float:
        """Return the part of the run that is over, from 0 to 1, by the limit that is nearer."""
        return min(1.0, max(iteration / self.max_iterations, self._time_part))

    def ends_by_iterations(self, iteration: int) -> bool:
        """Whether the limit of iterations is the nearer one."""
        return iteration / self.max_iterations >= self._time_part

    @property
    def _time_part(self) -> float:
        return 0.0 if self.max_minutes is None else self.elapsed_s / (60.0 * self.max_minutes)

    @property
    def time_is_over(self) -> bool:
        """Whether now is closer to the limit of time than the end of another iteration."""
        return self.max_minutes is not None and self.elapsed_s + 0.5 * self._last_s >= 60.0 * self.max_minutes

    def seconds_left(self, iteration: int) -> float:
        """Estimate the time until the nearer limit, after at least one iteration."""
        left = self.elapsed_s / (iteration - self.first_iteration) * (self.max_iterations - iteration)
        return (
            left
            if self.max_minutes is None
            else min(left, max(0.0, 60.0 * self.max_minutes - self.elapsed_s))
        )
