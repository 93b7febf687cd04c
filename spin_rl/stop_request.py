"""Ctrl-C, a job scheduler, or the end of what launched a process, as a request to end in good order."""

from __future__ import annotations

import os
import signal
import threading
import time
from types import FrameType, TracebackType
from typing import Any

_LAUNCHER = os.getppid() if "TORCHELASTIC_RUN_ID" in os.environ else None
"""torchrun, if it is what started this process."""

SAME_REQUEST_S = 1.0
"""Launchers pass a Ctrl-C on to processes that got it already: signals this close are one request."""


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
