"""Terminal table of the dynamic benchmark, beside the paper's table of static and dynamic obstacles."""

from __future__ import annotations

from typing import Any

from spin_rl.benchmark.tables.paper import STATIC_DYNAMIC
from spin_rl.benchmark.tables.reach import align, figures, main_causes, notes, title
from spin_rl.benchmark.tables.reach import headline as success_headline

METHODS = ("SPIN", "Classical")


def table(result: dict[str, Any]) -> str:
    """Format a result of `dynamic.evaluate_dynamic` for the terminal."""
    heading = title("Dynamic", result, f"{result['rows'][0]['episodes']} episodes per row")
    header = [
        "scene",
        "obstacles",
        "success",
        "95%",
        "time",
        "collisions",
        "95%",
        *METHODS,
        "failures by cause",
    ]
    body = []
    for row in result["rows"]:
        low, high = row["collisions_ci95"]
        paper = STATIC_DYNAMIC[row["scene"], row["obstacles"]]
        hits = [f"{row['collisions']:.2f}", f"{low:.2f}-{high:.2f}"]
        beside = [f"{paper[name].success_rate:.1f} {paper[name].collisions:.1f}" for name in METHODS]
        body.append([row["scene"], row["obstacles"], *figures(row), *hits, *beside, main_causes(row)])
    paper_note = "paper (real robot): success and collisions of an episode, of few runs"
    return "\n".join([heading, *align([header, *body]), f"{notes(result, in_paper=False)}; {paper_note}"])


def headline(result: dict[str, Any]) -> str:
    """One line that sums a result up."""
    rows = result["rows"]
    mean = sum(row["collisions"] for row in rows) / len(rows)
    return f"{success_headline(result)}, {mean:.2f} collisions an episode"
