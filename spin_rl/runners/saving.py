"""When a run saves, and where to."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from spin_rl.runners.checkpoint import save_numbered

RETRY_S = 60.0
"""Time after a failure until saving is tried again."""


class Saver:
    """The checkpoints of a run; all processes have one and agree on when it saves, the main one writes."""

    def __init__(self, run_dir: Path | None, interval: int, minutes: float | None) -> None:
        """Save into the run's folder.

        Args:
            run_dir: The folder; None saves nothing.
            interval: Iterations between two.
            minutes: Wall time after which one is saved in any case [min]; None for no such limit.
        """
        self._folder = None if run_dir is None else run_dir / "checkpoints"
        self._interval = interval
        self._limit_s = None if minutes is None else 60.0 * minutes
        self._saved_s = 0.0
        self._retry_s: float | None = None

    @property
    def last(self) -> Path | None:
        """The newest checkpoint."""
        return None if self._folder is None else self._folder / "last.pt"

    def is_due(self, iteration: int, elapsed_s: float) -> bool:
        """Whether to save after an iteration, `elapsed_s` after the start [s]."""
        if self._folder is None:
            return False
        if self._retry_s is not None:
            return elapsed_s >= self._retry_s
        is_late = self._limit_s is not None and elapsed_s - self._saved_s >= self._limit_s
        return is_late or iteration % self._interval == 0

    def note(self, elapsed_s: float, failed: bool) -> None:
        """Take note of what became of saving, `elapsed_s` after the start [s]."""
        self._retry_s = elapsed_s + RETRY_S if failed else None
        self._saved_s = self._saved_s if failed else elapsed_s

    def write(self, iteration: int, state: Mapping[str, Any]) -> None:
        """Write a checkpoint.

        Raises:
            OSError: It cannot be written; the last one is still there.
        """
        assert self._folder is not None
        save_numbered(self._folder, iteration, state)
