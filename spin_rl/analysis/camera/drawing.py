"""Where a camera looks, as a figure: how often it takes each pose, and episodes over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

_PAN, _TILT = "#16697a", "#c0392b"
_LEAST = 1e-4
"""Smallest share of the time that has a colour."""


def draw_looking(rows: Sequence[tuple[str, dict[str, Any]]], path: Path) -> None:
    """Draw a row for each camera: a heat map of its poses, then single episodes.

    In an episode the ground is grey while the base drives backwards, and dotted lines are when something
    comes out.

    Args:
        rows: Titles, and `looking` of a result of the camera analysis.
        path: Image file to write; its folder is made.
    """
    from matplotlib.figure import Figure

    most = max(len(looking["examples"]) for _, looking in rows)
    figure = Figure(figsize=(4.2 + 3.2 * most, 2.9 * len(rows)), layout="constrained")
    grid = figure.subplots(len(rows), 1 + most, squeeze=False, width_ratios=[1.3, *[1.0] * most])
    for axes, (title, looking) in zip(grid, rows, strict=True):
        _draw_share(axes[0], looking["share"])
        axes[0].set_title(title, fontsize=9)
        for axis, example in zip(axes[1:], looking["examples"], strict=False):
            _draw_example(axis, example)
        if looking["examples"]:
            axes[1].legend(fontsize=7, loc="lower left")
        for axis in axes[1 + len(looking["examples"]) :]:
            axis.axis("off")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=90)


def _draw_share(axis: Any, share: dict[str, Any]) -> None:
    from matplotlib.colors import LogNorm

    values = np.array(share["share"]).T
    mesh = axis.pcolormesh(
        share["pan_edges"],
        share["tilt_edges"],
        np.where(values >= _LEAST, values, np.nan),
        cmap="viridis",
        norm=LogNorm(_LEAST, 1.0),
    )
    axis.figure.colorbar(mesh, ax=axis, label="share of the time")
    axis.set_xlabel("pan [rad]: 0 ahead, -1.57 right, -3.14 behind", fontsize=7)
    axis.set_ylabel("tilt [rad]: -1.5 at the wheels", fontsize=7)
    axis.tick_params(labelsize=7)


def _draw_example(axis: Any, example: dict[str, Any]) -> None:
    time, speed = example["time_s"], np.array(example["speed_m_s"])
    axis.plot(time, example["pan_rad"], color=_PAN, linewidth=1.3, label="pan")
    axis.plot(time, example["tilt_rad"], color=_TILT, linewidth=1.3, label="tilt")
    back = speed < -0.02
    axis.fill_between(time, 0.0, 1.0, where=back, color="0.88", transform=axis.get_xaxis_transform())
    for moment in example["comes_out_s"]:
        axis.axvline(moment, color="0.4", linewidth=0.8, linestyle=":")
    axis.set_title(f"world {example['world']}, {example['outcome']}", fontsize=8)
    axis.set_xlabel("time [s]", fontsize=7)
    axis.set_ylabel("pan, tilt [rad]", fontsize=7)
    axis.tick_params(labelsize=7)
