"""The behaviour analysis for people: tables and figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from spin_rl.analysis.behaviour.drawing import bin_names, draw_episodes, draw_summary
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
    labels = bin_names(values)
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
    """Draw tendencies and counts, and, with `_episodes` behind the name, the examples over time.

    Args:
        result: Of `analysis.analyse_behaviour`.
        path: Image file to write; its folder is made.
    """
    tendencies = result["tendencies"].values()
    titles = [f"{values['name']}\n{_difference(values)}" for values in tendencies]
    draw_summary(result, path, titles, [bin_names(values) for values in tendencies])
    if told := [event for event in result["events"] if "series" in event]:
        draw_episodes(told, result["policy"], path.with_stem(f"{path.stem}_episodes"))
