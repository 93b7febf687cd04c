"""Stopping a run by Ctrl-C or by a job scheduler."""

from __future__ import annotations

import signal
import threading
import time
from types import FrameType, TracebackType
from typing import Any

SAME_REQUEST_S = 1.0
"""Launchers pass a terminal's Ctrl-C on to processes that got it already: signals this close are one request."""


class StopRequest:
    """Context in which the first SIGINT or SIGTERM is a request, and a second one ends the process at once."""

    def __init__(self) -> None:
        self.name: str | None = None
        self._time = 0.0
        self._previous: dict[int, Any] = {}

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
        if self.name is None:
            self.name, self._time = signal.Signals(number).name, now
            print(f"\n{self.name}: stopping after this iteration; again to stop at once.", flush=True)
        elif now - self._time > SAME_REQUEST_S:
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)
