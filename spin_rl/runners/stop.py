"""What ends a run: its limits, Ctrl-C, a job scheduler, or the end of what launched its processes."""

from __future__ import annotations

import math
import os
import signal
import threading
import time
from dataclasses import dataclass
from types import FrameType, TracebackType
from typing import Any

_LAUNCHER = os.getppid() if "TORCHELASTIC_RUN_ID" in os.environ else None
"""torchrun, if it is what started this process."""

SAME_REQUEST_S = 1.0
"""Launchers pass a Ctrl-C on to processes that got it already: signals this close are one request."""


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


class Interrupted(Exception):
    """What was waited for did not come before the run had to end."""


class StopRequest:
    """Context in which the first SIGINT or SIGTERM is a request and a second one ends the process.

    The end of torchrun is a request too: nobody else would end its processes.
    """

    def __init__(self, when: str = "after this iteration") -> None:
        """Take no requests yet; `when` tells the user when the end will come."""
        self._when = when
        self._name: str | None = None
        self._time = 0.0
        self._previous: dict[int, Any] = {}

    @property
    def name(self) -> str | None:
        """What asked for the end, a signal's name or words; None as long as nothing did."""
        if self._name is None and _LAUNCHER not in (None, os.getppid()):
            self._name = "the end of its launcher"
        return self._name

    def __enter__(self) -> StopRequest:
        if threading.current_thread() is threading.main_thread():  # only there can handlers be set
            for number in (signal.SIGINT, signal.SIGTERM):
                self._previous[number] = signal.signal(number, self._handle)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        now = time.monotonic()
        if self._name is None:
            self._name, self._time = signal.Signals(number).name, now
            print(f"\n{self._name}: stopping {self._when}; again to stop at once.", flush=True)
        elif now - self._time > SAME_REQUEST_S:
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)
