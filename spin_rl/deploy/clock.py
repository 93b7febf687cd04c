"""The clock of real robots, and the signals that end a run."""

from __future__ import annotations

import signal
import threading
import time
from types import FrameType
from typing import Any


class MonotonicClock:
    """The system's clock that is never set."""

    def now(self) -> float:
        """Return the time [s]."""
        return time.monotonic()

    def sleep_until(self, time_s: float) -> None:
        """Sleep until a time [s]."""
        time.sleep(max(time_s - time.monotonic(), 0.0))


class StopSignals:
    """Notes Ctrl-C, SIGTERM and a lost terminal while it is entered; a second one is a `KeyboardInterrupt`.

    There is one interrupt at most. A robot that is being stopped must not be left at it: see `ignore`.

    Attributes:
        name: Of the signal that came, None if none did.
    """

    _CAUGHT = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

    def __init__(self) -> None:
        self.name: str | None = None
        self._ignores = False
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> StopSignals:
        """Catch the signals; in another thread than the main one there are none to catch."""
        if threading.current_thread() is not threading.main_thread():
            return self
        for caught in self._CAUGHT:
            self._before[caught] = signal.signal(caught, self._note)
        return self

    def __exit__(self, *error: object) -> None:
        """Handle them as before."""
        for caught, handler in self._before.items():
            signal.signal(caught, handler)

    def ignore(self) -> None:
        """Interrupt nothing any more, up to the end."""
        self._ignores = True

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self._ignores:
            return
        if self.name is not None:
            self._ignores = True
            raise KeyboardInterrupt
        self.name = signal.Signals(number).name
