"""The learning curve of a run, short enough to keep with a result."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

POINTS = 40
_TAGS = {"success_rate": "Episode/success_rate", "level": "Episode/level"}


def read_curve(run_dir: Path) -> dict[str, list[float]]:
    """Read what a run has written for TensorBoard.

    Returns:
        `env_steps` and, as means over the iterations around, `success_rate` and `level` of the training:
        lists of at most `POINTS` numbers.
    """
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(run_dir), size_guidance={"scalars": 0})
    events.Reload()
    samples = {event.step: event.value for event in events.Scalars("Perf/env_steps")}
    series = {name: {e.step: e.value for e in events.Scalars(tag)} for name, tag in _TAGS.items()}
    return shorten(
        [samples[step] for step in sorted(samples)],
        {name: [values.get(step, math.nan) for step in sorted(samples)] for name, values in series.items()},
    )


def shorten(env_steps: list[float], series: dict[str, list[float]]) -> dict[str, list[float]]:
    """Average curves over at most `POINTS` equal parts; iterations without a value do not count.

    Args:
        env_steps: Samples at the end of every iteration, rising.
        series: Values of the same iterations, NaN where there was no episode.
    """
    parts = [part for part in np.array_split(np.arange(len(env_steps)), POINTS) if len(part)]
    known = [part for part in parts if all(np.isfinite(np.take(v, part)).any() for v in series.values())]
    curve = {"env_steps": [float(env_steps[part[-1]]) for part in known]}
    for name, values in series.items():
        curve[name] = [round(float(np.nanmean(np.take(values, part))), 4) for part in known]
    return curve
