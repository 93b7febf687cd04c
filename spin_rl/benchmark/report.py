"""Reports: the terminal table beside the paper's rows, and JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from spin_rl.benchmark.paper import REACH
from spin_rl.benchmark.settings import noise_label
from spin_rl.runners.checkpoint import write_atomically

_PAPER_ROWS = ("SPIN (CVO)", "FixCam")
_MAX_CAUSES = 3


def table(result: dict[str, Any]) -> str:
    """Format a result of `reach.evaluate_reach` for the terminal, with the paper's rows where it has them."""
    seeds = ", ".join(str(seed) for seed in result["seeds"])
    title = (
        f"Reach: {result['policy']}, {result['rows'][0]['episodes']} episodes per cell (seeds {seeds}), "
        f"robot {result['robot']}, camera {result['camera_mount']}{conditions_note(result)}"
    )
    in_paper = "scene" not in result and all(
        (row["scenario"], row["difficulty"]) in REACH[_PAPER_ROWS[0]] for row in result["rows"]
    )
    paper = _PAPER_ROWS if in_paper else ()
    header = ["scenario", "", "success", "95%", "time", *paper, "failures by cause"]
    body = [_line(row, paper) for row in result["rows"]]
    note = "time: mean of the successful episodes"
    if result.get("overflows"):
        note = f"WARNING: physics dropped contacts or constraints: {result['overflows']}\n{note}"
    if paper:
        note += "; paper (Table 1): success and mean episode time of 30 episodes"
    return "\n".join([title, *align([header, *body]), note])


def conditions_note(result: dict[str, Any]) -> str:
    """End of a title: the noise of depth images where there are any, the corridors if not the benchmark's."""
    depth = result.get("depth")
    note = "" if depth is None else f", depth noise {noise_label(depth['noise'])}"
    return note + (f", scene {result['scene']}" if "scene" in result else "")


def _line(row: dict[str, Any], paper: tuple[str, ...]) -> list[str]:
    low, high = row["ci95"]
    duration = row["duration_s"]
    cells = [
        str(row["scenario"]),
        row["difficulty"],
        f"{row['success_rate']:.2f}",
        f"{low:.2f}-{high:.2f}",
        "-" if duration is None else f"{duration:.1f} s",
    ]
    for name in paper:
        figures = REACH[name][row["scenario"], row["difficulty"]]
        cells.append(f"{figures.success_rate:.2f} {figures.duration_s:4.1f} s")
    return [*cells, main_causes(row)]


def main_causes(row: dict[str, Any]) -> str:
    """Name the most frequent causes of a row's failures, such as `base 60%, timeout 20%`."""
    causes = sorted(row["causes"].items(), key=lambda item: -item[1])
    return ", ".join(f"{name} {share:.0%}" for name, share in causes[:_MAX_CAUSES] if share > 0.0) or "-"


def align(rows: list[list[str]]) -> list[str]:
    """Pad the columns of rows of equal length, and join each row into a line."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows]


def headline(result: dict[str, Any]) -> str:
    """One line that sums a result up."""
    rows = result["rows"]
    mean = sum(row["success_rate"] for row in rows) / len(rows)
    return f"mean success {mean:.2f} over {len(rows)} cells, {sum(row['episodes'] for row in rows)} episodes"


def write_json(result: dict[str, Any], path: Path) -> None:
    """Write a result to a file that is complete or not there; its folder is made.

    Rates and shares are in [0, 1], times in seconds, distances in metres.
    """
    text = json.dumps(result, indent=2, allow_nan=False) + "\n"
    write_atomically(path, lambda file: file.write(text.encode()))
