"""Report of the pick benchmark: the terminal table beside the paper's figures."""

from __future__ import annotations

from typing import Any

from spin_rl.benchmark.tables import paper
from spin_rl.benchmark.tables.reach import (
    PAPER_ROWS,
    align,
    figures,
    main_causes,
    notes,
    paper_figures,
    title,
)
from spin_rl.scenes.objects.shapes import OBJECTS


def table(result: dict[str, Any]) -> str:
    """Format a result of `pick.evaluate_pick` for the terminal; the paper has no figures by object."""
    overall = result["overall"]
    heading = title("Pick", result, f"{overall['episodes']} episodes")
    in_paper = "scene" not in result and {row["object"] for row in result["rows"]} == set(OBJECTS)
    columns = PAPER_ROWS if in_paper else ()
    header = ["object", "success", "95%", "time", "untouched", "episodes", *columns, "failures by cause"]
    lines = []
    for name, row in [("all", overall), *((row["object"], row) for row in result["rows"])]:
        beside = [paper_figures(paper.PICK[method]) if row is overall else "" for method in columns]
        untouched = f"{row['untouched_rate']:.2f}"
        lines.append([name, *figures(row), untouched, str(row["episodes"]), *beside, main_causes(row)])
    return "\n".join([heading, *align([header, *lines]), notes(result, in_paper)])


def headline(result: dict[str, Any]) -> str:
    """One line that sums a result up."""
    overall = result["overall"]
    worst = min(result["rows"], key=lambda row: row["success_rate"])
    low, high = overall["ci95"]
    return (
        f"success {overall['success_rate']:.2f} ({low:.2f}-{high:.2f}) in {overall['episodes']} episodes, "
        f"least {worst['object']} {worst['success_rate']:.2f}"
    )
