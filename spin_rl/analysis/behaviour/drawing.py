"""The behaviour analysis as figures: tendencies and counts, and single episodes over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from spin_rl.analysis.behaviour.series import LABELS


def draw_summary(
    result: dict[str, Any], path: Path, titles: Sequence[str], bins: Sequence[Sequence[str]]
) -> None:
    """Draw the tendencies and the counts of the behaviours.

    Args:
        result: Of `analysis.analyse_behaviour`.
        path: Image file to write; its folder is made.
        titles: Of the tendencies.
        bins: Names of their bins.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 6.4), layout="constrained")
    figure.suptitle(f"{result['policy']}: camera, arm and behaviours", fontsize=11)
    *axes, last = figure.subplots(2, 2).flat
    for axis, values, title, labels in zip(axes, result["tendencies"].values(), titles, bins, strict=True):
        heights = [math.nan if mean is None else mean for mean in values["means"]]
        axis.bar(labels, heights, color="#16697a")
        axis.set_title(title, fontsize=9)
        axis.set_ylabel(f"mean [{values['unit']}]")
        axis.tick_params(axis="x", labelsize=7, rotation=15)
        axis.axhline(0.0, color="0.5", linewidth=0.8)
    _draw_counts(last, result["behaviours"])
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def _draw_counts(axis: Any, behaviours: dict[str, dict[str, Any]]) -> None:
    left = dict.fromkeys(behaviours, 0)
    colours = {"shown": "#2a9d8f", "not_needed": "#cccccc", "failed": "#c0392b"}
    for key, colour in colours.items():
        counts = [behaviours[name][key] for name in behaviours]
        axis.barh(
            list(behaviours), counts, left=list(left.values()), color=colour, label=key.replace("_", " ")
        )
        left = {name: left[name] + behaviours[name][key] for name in behaviours}
    axis.invert_yaxis()
    axis.set_title("situations", fontsize=9)
    axis.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=3, frameon=False)


def draw_episodes(events: Sequence[dict[str, Any]], policy: str, path: Path) -> None:
    """Draw episodes over time, a column each: the situation begins at the line.

    Args:
        events: Those of a result that have a `series`, at least one.
        policy: Who acted.
        path: Image file to write; its folder is there.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.2 * len(events), 8.0), layout="constrained")
    figure.suptitle(f"{policy}: episodes over time [s]", fontsize=11)
    rows = figure.subplots(len(LABELS), len(events), squeeze=False, sharex="col")
    for column, event in enumerate(events):
        series = event["series"]
        rows[0][column].set_title(f"{event['behaviour']}, {event['result']}", fontsize=9)
        for row, (name, label) in enumerate(LABELS.items()):
            axis = rows[row][column]
            axis.plot(series["time_s"], series[name], color="#16697a", linewidth=1.3)
            axis.axvline(event["time_s"], color="#c0392b", linewidth=0.9)
            axis.tick_params(labelsize=7)
            if column == 0:
                axis.set_ylabel(label, fontsize=7)
            if name == "hand_m" and series["floats"]:
                axis.axhspan(*series["obstacle_m"], color="#f4a259", alpha=0.4)
    figure.savefig(path, dpi=90)


def bin_names(values: dict[str, Any]) -> list[str]:
    """Names of the bins of a tendency, such as `0.6 to 1 m`."""
    return [_bin(low, high, values["edge_unit"]) for low, high in pairwise(values["edges"])]


def _bin(low: float, high: float | None, unit: str) -> str:
    if high is None:
        return f"over {low:g} {unit}"
    if unit == "rad":
        return f"{math.degrees(low):.0f} to {math.degrees(high):.0f} deg"
    return f"{low:g} to {high:g} {unit}"
