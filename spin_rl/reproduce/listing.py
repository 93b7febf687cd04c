"""The list of steps as text."""

from __future__ import annotations

from collections.abc import Sequence

from spin_rl.reproduce.estimate import duration, minutes_left, time_ahead
from spin_rl.reproduce.plan import Step, Steps
from spin_rl.reproduce.state import command_of, state_of


def progress(steps: Steps, chosen: Sequence[Step], jobs: int) -> str:
    """The list of steps: what is done, what is missing, and how long it takes with some steps at a time."""
    rows = [("step", "state", "samples", "time", "success", "")]
    left: dict[str, float] = {}
    group = ""
    lines: list[tuple[str, ...] | str] = []
    for step in chosen:
        if step.group != group:
            group = step.group
            lines.append(f"{group}: {step.claim}")
        state = state_of(steps, step)
        if state.status != "done":
            left[step.name] = minutes_left(steps, step)
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
    done = f"{len(chosen) - len(left)} of {len(chosen)} steps done"
    return "\n".join(
        [*text, f"{done}; about {duration(time_ahead(steps, left, jobs))} left, {jobs} at a time"]
    )
