"""A step that runs: a process of its own, whose output is in a file."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from filelock import FileLock

from spin_rl.reproduce.plan import Step

_TOOLS = {"train": "train", "eval": "evaluate", "bench": "bench"}
"""Name of a command after `spin-` -> its module in spin_rl.cli."""
_TAIL_BYTES = 4096


@dataclass
class Child:
    """A step that runs.

    Attributes:
        step: Which.
        process: It.
        log: File of its output.
        lock: Keeps other calls from running the step; held until it has ended.
        out: File that it writes its result to; None for a training.
    """

    step: Step
    process: subprocess.Popen[bytes]
    log: Path
    lock: FileLock
    out: Path | None
    _start: float = field(default_factory=time.monotonic)

    @property
    def minutes(self) -> float:
        """How long it has been running."""
        return (time.monotonic() - self._start) / 60.0

    def has_ended(self) -> bool:
        """Whether it has, without waiting."""
        return self.process.poll() is not None

    def ask_to_end(self) -> None:
        """Send it one SIGTERM, after which a training saves; a second one would end it at once."""
        if not self.has_ended():
            self.process.send_signal(signal.SIGTERM)

    def wait(self, seconds: float) -> None:
        """Wait for its end, and kill it if that does not come: checkpoints are whole at any time."""
        with suppress(subprocess.TimeoutExpired):
            self.process.wait(seconds)
        if not self.has_ended():
            self.process.kill()
            self.process.wait()

    def last_line(self) -> str:
        """The last line of its output, empty if there is none."""
        with open(self.log, "rb") as file:
            file.seek(max(0, self.log.stat().st_size - _TAIL_BYTES))
            text = file.read().decode(errors="replace")
        return next((line.strip() for line in reversed(re.split(r"[\r\n]", text)) if line.strip()), "")


def python(tool: str, arguments: Sequence[str]) -> list[str]:
    """Command line of one of this package's commands; `tool` is what comes after `spin-`."""
    return [sys.executable, "-m", f"spin_rl.cli.{_TOOLS[tool]}", *arguments]


def started(command: Sequence[str], log: Path) -> subprocess.Popen[bytes]:
    """Start a process in a session of its own, so that it gets a Ctrl-C once, from us; on one core."""
    log.parent.mkdir(parents=True, exist_ok=True)
    with open(log, "wb") as output:
        return subprocess.Popen(
            command,
            env=os.environ | {"OMP_NUM_THREADS": "1"},
            start_new_session=True,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
        )
