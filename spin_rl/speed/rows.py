"""Throughput: rows of measured figures beside their peers, with the hardware they were measured on."""

from __future__ import annotations

import importlib.metadata
import platform
from dataclasses import asdict, dataclass
from typing import Any

from spin_rl.machine import commit, hardware
from spin_rl.speed.timing import Timing

_PACKAGES = ("torch", "warp-lang", "mujoco", "mujoco-warp", "rsl-rl-lib", "numpy")


@dataclass(frozen=True)
class Row:
    """One figure.

    Attributes:
        name: What was measured.
        value: Median over the blocks.
        unit: Unit of `value`.
        baseline: The peer that was measured in the same run; None if there is none.
        ratio: How many times better than the baseline, whether less is better or more is.
        spread: Worst and best block, in units of `value`, lower figure first.
        baseline_value: Median of the baseline, in units of `value`.
    """

    name: str
    value: float
    unit: str
    baseline: str | None
    ratio: float | None
    spread: tuple[float, float]
    baseline_value: float | None


def rate_row(
    name: str, timing: Timing, unit: str, baseline: str | None = None, peer: Timing | None = None
) -> Row:
    """A row of units of work per second.

    Args:
        name: What was measured.
        timing: Its timing, per unit of work.
        unit: Unit of the figure, such as "env steps/s".
        baseline: Name of the peer.
        peer: Timing of the peer in the same blocks, per the same unit of work.
    """
    low, high = 1.0 / max(timing.blocks), 1.0 / min(timing.blocks)
    ratio = timing.times_better_than(peer) if peer else None
    return Row(
        name, 1.0 / timing.median, unit, baseline, ratio, (low, high), 1.0 / peer.median if peer else None
    )


def cost_row(
    name: str, timing: Timing, unit: str, baseline: str | None = None, peer: Timing | None = None
) -> Row:
    """A row of microseconds per unit of work; arguments as in `rate_row`."""
    ratio = timing.times_better_than(peer) if peer else None
    spread = (1e6 * min(timing.blocks), 1e6 * max(timing.blocks))
    return Row(name, 1e6 * timing.median, unit, baseline, ratio, spread, 1e6 * peer.median if peer else None)


def result(device: str, rows: list[Row], **settings: Any) -> dict[str, Any]:
    """Put rows, device, machine and settings together, ready for JSON."""
    return {
        "device": device,
        "rows": [asdict(row) for row in rows],
        "hardware": hardware(device),
        "versions": {"python": platform.python_version()}
        | {name: importlib.metadata.version(name) for name in _PACKAGES},
        "commit": commit(),
        "settings": settings,
    }


def table(rows: list[Row]) -> str:
    """Format rows for the terminal."""
    lines = [["measured", "median", "min-max of blocks", "unit", "ratio", "baseline"]]
    for row in rows:
        ratio = "-" if row.ratio is None else f"{row.ratio:.2f}x"
        peer = "-"
        if row.baseline is not None and row.baseline_value is not None:
            peer = f"{row.baseline} ({_figure(row.baseline_value)})"
        spread = "-".join(_figure(value) for value in row.spread)
        lines.append([row.name, _figure(row.value), spread, row.unit, ratio, peer])
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )


def _figure(value: float) -> str:
    return f"{value:,.0f}" if value >= 100.0 else f"{value:.3g}"
