"""Reports of the fetch and place benchmarks: the paper's Table 1 whole, and what it does not tell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from spin_rl.benchmark.tables import paper
from spin_rl.benchmark.tables.reach import align, cell_table, figures, main_causes, notes, title
from spin_rl.scenes.objects.shapes import OBJECTS

_METHODS = ("SPIN (CVO)", "SPIN (DVO)", "FixCam", "NoPointNet", "Mapping")
_READING = (
    "reach and place: of all fetches; pick: of those reached, all cells together. "
    "time: of pick, align + pick;\nof place, retract + carry + place"
)


def table(result: dict[str, Any]) -> str:
    """Format a result of `fetch.evaluate_fetch` for the terminal, beside the paper's Table 1."""
    in_paper = _is_papers(result)
    cells = {f"S{row['scenario']} {row['difficulty']}": row for row in result["rows"]}
    objects = {row["object"]: row for row in result["objects"]}
    blocks = [
        [title("Fetch", result, f"{result['rows'][0]['episodes']} episodes per cell")],
        [*align(_table_1(result, _METHODS if in_paper else ())), _READING],
        align(_details("cell", cells)),
        align(_details("object", objects | {"all": result["overall"]})),
        [*_stages(result["overall"]), notes(result, in_paper)],
    ]
    return "\n\n".join("\n".join(block) for block in blocks)


def place_table(result: dict[str, Any]) -> str:
    """Format a result of `fetch.evaluate_fetch` with benchmark="place" for the terminal."""
    of_picked = {"of picked": lambda row: _share(row["place"])}
    text = cell_table("Place", result, paper.PLACE if _is_papers(result) else None, of_picked)
    return f"{text}\nsuccess: of all fetches; time: retract + carry + place"


def headline(result: dict[str, Any]) -> str:
    """One line that sums a result up."""
    overall = result["overall"]
    low, high = overall["ci95"]
    parts = ", ".join(f"{part} {_share(overall[part])}" for part in ("reach", "pick", "place"))
    return f"fetched {overall['success_rate']:.2f} ({low:.2f}-{high:.2f}) of {overall['episodes']}; {parts}"


def _is_papers(result: dict[str, Any]) -> bool:
    """Whether scenes and objects are those that stand for the paper's."""
    return "scene" not in result and {row["object"] for row in result["objects"]} == set(OBJECTS)


def _table_1(result: dict[str, Any], methods: Sequence[str]) -> list[list[str]]:
    """Table 1: success, then times, of this pair of policies and of the paper's methods."""
    cells = [(row["scenario"], row["difficulty"]) for row in result["rows"]]
    # Of each line: success rate and time of the cells of reach, of pick, and of the cells of place.
    lines = {"this pair": _figures_of_pair(result)} | {
        method: [
            (cell.success_rate, cell.duration_s)
            for cell in (
                *(paper.REACH[method][cell] for cell in cells),
                paper.PICK[method],
                *(paper.PLACE[method][cell] for cell in cells),
            )
        ]
        for method in methods
    }
    difficulties = [difficulty for _, difficulty in cells]
    scenarios = [f"S{scenario}" if name == difficulties[0] else "" for scenario, name in cells]
    blank = [""] * (len(cells) - 1)
    rows = [["", "Reach", *blank, "Pick", "Place", *blank], ["", *scenarios, "", *scenarios]]
    headings = ["success", *difficulties, "", *difficulties], ["time [s]", *[""] * (2 * len(cells) + 1)]
    for i, heading in enumerate(headings):
        rows.append(heading)
        rows += [[label, *(_two_decimals(figure[i]) for figure in line)] for label, line in lines.items()]
    return rows


def _figures_of_pair(result: dict[str, Any]) -> list[tuple[float | None, float | None]]:
    pick = result["overall"]["pick"]
    reach, place = (
        [(row[part]["success_rate"], row[part]["duration_s"]) for row in result["rows"]]
        for part in ("reach", "place")
    )
    return [*reach, (pick["success_rate_of_tried"], pick["duration_s"]), *place]


def _details(heading: str, rows: dict[str, dict[str, Any]]) -> list[list[str]]:
    """What became of the fetches of each row, by its label."""
    parts = ("reach", "pick", "place")
    body = [
        [label, *figures(row), *(_share(row[part]) for part in parts), main_causes(row)]
        for label, row in rows.items()
    ]
    return [[heading, "fetched", "95%", "time", *parts, "failures by cause"], *body]


def _stages(overall: dict[str, Any]) -> list[str]:
    times = ", ".join(f"{name} {seconds:.1f} s" for name, seconds in overall["stage_s"].items() if seconds)
    counts = ", ".join(f"{name} {overall[name]}" for name in ("retries", "drops", "scrapes"))
    return [
        *([f"stages of successful fetches: {times}"] if times else []),
        f"of all fetches: {counts} (control steps in which a carried object touched the scene)",
    ]


def _share(part: dict[str, Any]) -> str:
    return f"{part['succeeded']}/{part['tried']}"


def _two_decimals(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
