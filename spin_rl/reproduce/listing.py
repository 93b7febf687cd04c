"""The list of steps as text."""

from __future__ import annotations

from collections.abc import Sequence

from spin_rl.reproduce.plan import Step, Steps, Training
from spin_rl.reproduce.state import command_of, state_of


def progress(steps: Steps, chosen: Sequence[Step], processes: int = 1) -> str:
    """The list of steps: what is done, what is missing, and how long it takes in some processes."""
    rows = [("step", "state", "samples", "time", "success", "")]
    left = 0.0
    count = 0
    group = ""
    lines: list[tuple[str, ...] | str] = []
    for step in chosen:
        if step.group != group:
            group = step.group
            lines.append(f"{group}: {step.claim}")
        state = state_of(steps, step)
        is_missing = state.status != "done"
        done_part = min(1.0, (state.env_steps or 0) / step.env_steps) if isinstance(step, Training) else 0.0
        if is_missing:
            left += step.minutes * (1.0 - done_part) / steps.side_by_side(step, processes)
        count += not is_missing
        time_text = f"about {step.minutes:.0f} min" if state.minutes is None else f"{state.minutes:.1f} min"
        samples = "" if state.env_steps is None else f"{state.env_steps / 1e6:.2f} M"
        success = "" if state.success is None else f"{state.success:.2f}"
        lines.append((f"  {step.name}", state.status, samples, time_text, success, command_of(steps, step)))
    table = [line for line in (rows[0], *lines) if isinstance(line, tuple)]
    widths = [max(len(row[i]) for row in table) for i in range(5)]
    text = [
        line
        if isinstance(line, str)
        else "  ".join([*(cell.ljust(w) for cell, w in zip(line, widths, strict=False)), line[5]]).rstrip()
        for line in (rows[0], *lines)
    ]
    return "\n".join([*text, f"{count} of {len(chosen)} steps done; about {duration(left)} left"])


def duration(minutes: float) -> str:
    """Write a time [min] such as `2 h 05 min`."""
    hours, rest = divmod(round(minutes), 60)
    return f"{hours} h {rest:02d} min" if hours else f"{rest} min"
