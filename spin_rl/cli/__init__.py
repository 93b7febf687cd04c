"""Command lines: thin Hydra entry points."""

from __future__ import annotations

import sys
from types import TracebackType


def _one_line_for_an_interrupt(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """Say nothing of where Ctrl-C met a command, not even while it imports."""
    if issubclass(kind, KeyboardInterrupt):
        print("interrupted", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)


if sys.excepthook is sys.__excepthook__:
    sys.excepthook = _one_line_for_an_interrupt
