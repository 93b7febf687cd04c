"""The behaviour analysis for people: tables and a figure."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

from spin_rl.analysis.behaviour.events import FAILED, SHOWN
from spin_rl.benchmark.tables.reach import align, title

_LISTED = 3


def table(result: dict[str, Any]) -> str:
    """Format a result of `analysis.analyse_behaviour` for the terminal."""
    heading = title("Behaviour", result, f"{result['rows'][0]['episodes']} episodes per condition")
    blocks = [[heading], *(_tendency(values) for values in result["tendencies"].values())]
    return "\n\n".join(
        "\n".join(block) for block in [*blocks, _behaviours(result), _examples(result)] if block
    )


def headline(result: dict[str, Any]) -> str:
    """One line that sums a result up."""
    counts = result["behaviours"].items()
    return ", ".join(f"{name} {count['shown']} of {count['situations']}" for name, count in counts)


def _tendency(values: dict[str, Any]) -> list[str]:
    labels = [_bin(low, high, values["edge_unit"]) for low, high in pairwise(values["edges"])]
    means = ["-" if mean is None else f"{mean:.2f}" for mean in values["means"]]
    rows = [
        ["", *labels],
        [f"mean [{values['unit']}]", *means],
        ["observations", *map(str, values["counts"])],
    ]
    return [f"{values['name']}: {_difference(values)}", *align(rows)]


def _difference(values: dict[str, Any]) -> str:
    if values["difference"] is None:
        return "no episode has both"
    interval = values["ci95"]
    ends = "" if interval is None else f" ({interval[0]:+.2f} to {interval[1]:+.2f})"
    return f"{values['difference']:+.2f} {values['unit']}{ends}, {values['episodes']} episodes"


def _bin(low: float, high: float | None, unit: str) -> str:
    if high is None:
        return f"over {low:g} {unit}"
    if unit == "rad":
        return f"{math.degrees(low):.0f} to {math.degrees(high):.0f} deg"
    return f"{low:g} to {high:g} {unit}"


def _behaviours(result: dict[str, Any]) -> list[str]:
    body = []
    for name, count in result["behaviours"].items():
        share = "-" if count["shown_share"] is None else f"{count['shown_share']:.2f}"
        interval = "-" if count["ci95"] is None else "{:.2f}-{:.2f}".format(*count["ci95"])
        numbers = [str(count[key]) for key in ("situations", "shown", "not_needed", "failed")]
        body.append([name, *numbers, share, interval])
    header = ["behaviour", "situations", "shown", "not needed", "failed", "share shown", "95%"]
    return [*align([header, *body]), "criteria: docs/behaviour_analysis.md"]


def examples(result: dict[str, Any], most: int) -> dict[str, list[dict[str, Any]]]:
    """The first events of each behaviour that were shown, and the first that failed.

    Args:
        result: Of `analysis.analyse_behaviour`.
        most: Of each kind.
    """
    return {
        f"{name}, {kind}": [
            event for event in result["events"] if event["behaviour"] == name and event["result"] == kind
        ][:most]
        for name in result["behaviours"]
        for kind in (SHOWN, FAILED)
    }


def _examples(result: dict[str, Any]) -> list[str]:
    rows = [
        [name, f"{event['time_s']:.1f} s", f"spin-play policy={result['policy']} {event['play']}"]
        for name, events in examples(result, _LISTED).items()
        for event in events
    ]
    return align([["", "at", "shown by"], *rows]) if rows else []


def plot(result: dict[str, Any], path: Path) -> None:
    """Draw the tendencies and the counts of the behaviours.

    Args:
        result: Of `analysis.analyse_behaviour`.
        path: Image file to write; its folder is made.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 6.4), layout="constrained")
    figure.suptitle(f"{result['policy']}: camera, arm and behaviours", fontsize=11)
    *axes, last = figure.subplots(2, 2).flat
    for axis, values in zip(axes, result["tendencies"].values(), strict=True):
        labels = [_bin(low, high, values["edge_unit"]) for low, high in pairwise(values["edges"])]
        heights = [math.nan if mean is None else mean for mean in values["means"]]
        axis.bar(labels, heights, color="#16697a")
        axis.set_title(f"{values['name']}\n{_difference(values)}", fontsize=9)
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
    axis.legend(fontsize=8, loc="center right")
