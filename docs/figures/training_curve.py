"""Plot a training run: python docs/figures/training_curve.py RUN OUT.png."""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

# Tag, axis label and whether rates of few episodes need smoothing.
PANELS = (
    ("Episode/success_rate", "success rate in training", True),
    ("Episode/level", "curriculum level (1: benchmark width)", False),
    ("Episode/mean_return", "episode return", True),
    ("Episode/collision_rate", "collision rate in training", True),
)


def plot(run: Path, out: Path) -> None:
    """Draw the panels over millions of environment steps."""
    events = EventAccumulator(str(run), size_guidance={"scalars": 0})
    events.Reload()
    steps = np.array([event.value for event in events.Scalars("Perf/env_steps")]) / 1e6
    figure, axes = plt.subplots(1, len(PANELS), figsize=(15, 3.2), layout="constrained")
    for axis, (tag, label, smooth) in zip(axes, PANELS, strict=True):
        values = np.array([event.value for event in events.Scalars(tag)])
        if smooth:
            axis.plot(steps, values, color="0.8", linewidth=0.6)
            window = np.ones(min(25, len(values)))
            valid = np.isfinite(values)
            weight = np.convolve(valid, window, "same")
            values = np.convolve(np.where(valid, values, 0.0), window, "same") / np.maximum(weight, 1)
        axis.plot(steps, values, color="tab:blue")
        axis.set(xlabel="million env steps", title=label)
        axis.grid(alpha=0.3)
    figure.savefig(out, dpi=110)
    print(f"Wrote {out}")


if __name__ == "__main__":
    plot(Path(sys.argv[1]), Path(sys.argv[2]))
