"""How long what is missing will take."""

from __future__ import annotations

import heapq
from collections.abc import Mapping

from spin_rl.reproduce.plan import Step, Steps, Training, is_alone
from spin_rl.reproduce.state import state_of


def minutes_left(steps: Steps, step: Step) -> float:
    """Minutes that a step that is not done is expected to take from here on."""
    if not isinstance(step, Training):
        return step.minutes
    state = state_of(steps, step)
    done_part = (state.env_steps or 0) / step.env_steps if state.status == "partial" else 0.0
    return step.minutes * (1.0 - done_part)


def time_ahead(steps: Steps, minutes: Mapping[str, float], jobs: int) -> float:
    """Minutes until all is done, some steps at a time, in order, each after what it needs, or alone.

    Args:
        steps: The plan.
        minutes: What each step that is left takes, by name, in the order of the plan.
        jobs: Steps at a time.
    """
    free = [0.0] * jobs
    ends: dict[str, float] = {}
    for name, takes in minutes.items():
        step = steps.by_name[name]
        needs = [ends.get(need, 0.0) for need in steps.needs(step)]
        if is_alone(step):
            ends[name] = max([*free, *needs]) + takes
            free = [ends[name]] * jobs
            continue
        ends[name] = max(heapq.heappop(free), *needs, 0.0) + takes
        heapq.heappush(free, ends[name])
    return max(ends.values(), default=0.0)


def duration(minutes: float) -> str:
    """Write a time [min] such as `2 h 05 min`."""
    hours, rest = divmod(round(minutes), 60)
    return f"{hours} h {rest:02d} min" if hours else f"{rest} min"
