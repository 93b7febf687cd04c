"""Plot training runs: python docs/figures/training_curve.py OUT.png RUN... (or name=RUN for the legend).

Several runs are drawn over each other; panels of one run show the raw values too.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

# Tag, title and whether rates of few episodes need smoothing.
PANELS = (
    ("Episode/success_rate", "success rate in training", True),
    ("Episode/level", "curriculum level (1: benchmark width)", False),
    ("Train/mean_reward", "episode return", True),
    ("Episode/collision_rate", "collision rate in training", True),
)
WINDOW = 25


def plot(out: Path, runs: dict[str, Path]) -> None:
    """Draw the panels over millions of environment steps."""
    figure, axes = plt.subplots(1, len(PANELS), figsize=(15, 3.2), layout="constrained")
    for name, run in runs.items():
        events = EventAccumulator(str(run), size_guidance={"scalars": 0})
        events.Reload()
        env_steps = {event.step: event.value / 1e6 for event in events.Scalars("Perf/env_steps")}
        for axis, (tag, title, smooth) in zip(axes, PANELS, strict=True):
            # Not every iteration has all tags: in asynchronous runs some have no new episodes.
            scalars = [event for event in events.Scalars(tag) if event.step in env_steps]
            steps = np.array([env_steps[event.step] for event in scalars])
            values = np.array([event.value for event in scalars])
            if smooth:
                if len(runs) == 1:
                    axis.plot(steps, values, color="0.8", linewidth=0.6)
                values = moving_mean(values)
            axis.plot(steps, values, label=name)
            axis.set(xlabel="million env steps", title=title)
    for axis in axes:
        axis.grid(alpha=0.3)
    if len(runs) > 1:
        axes[0].legend()
    figure.savefig(out, dpi=110)
    print(f"Wrote {out}")


def moving_mean(values: np.ndarray) -> np.ndarray:
    """Mean over the iterations around each one; those without an ended episode do not count."""
    window = np.ones(min(WINDOW, len(values)))
    valid = np.isfinite(values)
    weight = np.convolve(valid, window, "same")
    return np.convolve(np.where(valid, values, 0.0), window, "same") / np.maximum(weight, 1)


if __name__ == "__main__":
    named = [argument.rpartition("=") for argument in sys.argv[2:]]
    plot(Path(sys.argv[1]), {name or Path(run).name: Path(run) for name, _, run in named})
