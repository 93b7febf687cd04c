"""Reports: the terminal table of the reach benchmark beside the paper's rows, what tables share, and JSON."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from spin_rl.benchmark.settings import noise_label
from spin_rl.benchmark.tables.paper import REACH, PaperCell
from spin_rl.scenes.kinds import SCENARIO_NAMES

PAPER_ROWS = ("SPIN (CVO)", "FixCam")
_MAX_CAUSES = 3


def table(result: dict[str, Any]) -> str:
    """Format a result of `reach.evaluate_reach` for the terminal, with the paper's rows where it has them."""
    in_paper = "scene" not in result and all(
        (row["scenario"], row["difficulty"]) in REACH[PAPER_ROWS[0]] for row in result["rows"]
    )
    return cell_table("Reach", result, REACH if in_paper else None)


def cell_table(
    benchmark: str,
    result: dict[str, Any],
    paper: Mapping[str, Mapping[tuple[int, str], PaperCell]] | None,
    extra: Mapping[str, Callable[[dict[str, Any]], str]] = MappingProxyType({}),
) -> str:
    """Format rows by scenario and difficulty.

    Args:
        benchmark: Its name.
        result: Its result.
        paper: The paper's figures for it, None where these rows are not its cells.
        extra: Further columns, what they say of a row by their heading.
    """
    heading = title(benchmark, result, f"{result['rows'][0]['episodes']} episodes per cell")
    columns = PAPER_ROWS if paper else ()
    header = ["scenario", "", "success", "95%", "time", *extra, *columns, "failures by cause"]
    body = []
    for row in result["rows"]:
        cell = row["scenario"], row["difficulty"]
        more = [say(row) for say in extra.values()]
        beside = [paper_figures(paper[name][cell]) for name in columns] if paper else []
        name = SCENARIO_NAMES.get(cell[0])  # a scene file is a scenario of its own
        scenario = cell[0] if name is None else f"{cell[0]} {name}"
        body.append([scenario, cell[1], *figures(row), *more, *beside, main_causes(row)])
    return "\n".join([heading, *align([header, *body]), notes(result, paper is not None)])


def title(benchmark: str, result: dict[str, Any], episodes: str) -> str:
    """First line of a table.

    Args:
        benchmark: Its name.
        result: Result of any benchmark.
        episodes: How many there were.
    """
    policy = " + ".join(result[key] for key in ("policy", "pick") if key in result)
    seeds = ", ".join(str(seed) for seed in result["seeds"])
    pose = result.get("camera_pose")
    camera = result["camera_mount"] + ("" if pose is None else f" frozen at pan {pose[0]}, tilt {pose[1]}")
    return (
        f"{benchmark}: {policy}, {episodes} (seeds {seeds}), "
        f"robot {result['robot']}, camera {camera}{conditions_note(result)}"
    )


def notes(result: dict[str, Any], in_paper: bool) -> str:
    """Last lines of a table, with the paper's figures in it or not."""
    note = "time: mean of the successful episodes"
    if result.get("overflows"):
        note = f"WARNING: physics dropped contacts or constraints: {result['overflows']}\n{note}"
    return note + ("; paper (Table 1): success and mean episode time of 30 episodes" if in_paper else "")


def conditions_note(result: dict[str, Any]) -> str:
    """End of a title: noise of depth images and detector if there are any, scenes if not the benchmark's."""
    depth = result.get("depth")
    note = "" if depth is None else f", depth noise {noise_label(depth['noise'])}"
    if result.get("detector", "none") != "none":
        note += f", detector {result['detector']}"
    return note + (f", scene {result['scene']}" if "scene" in result else "")


def figures(row: dict[str, Any]) -> list[str]:
    """Success rate, its interval and the time of a row."""
    low, high = row["ci95"]
    duration = row["duration_s"]
    time = "-" if duration is None else f"{duration:.1f} s"
    return [f"{row['success_rate']:.2f}", f"{low:.2f}-{high:.2f}", time]


def paper_figures(cell: PaperCell) -> str:
    """A cell of the paper's table."""
    return f"{cell.success_rate:.2f} {cell.duration_s:4.1f} s"


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
    cells = "1 cell" if len(rows) == 1 else f"{len(rows)} cells"
    return f"mean success {mean:.2f} over {cells}, {sum(row['episodes'] for row in rows)} episodes"
