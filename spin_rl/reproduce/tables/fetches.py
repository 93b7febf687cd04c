"""The pick and place columns of Table 1, for the methods that can fetch."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from spin_rl.benchmark.tables.paper import PICK, PLACE
from spin_rl.reproduce.tables.corridors import CELLS, THEIRS
from spin_rl.reproduce.tables.notes import budget_note, known
from spin_rl.reproduce.tables.rates import Rate
from spin_rl.reproduce.tables.stored import Cell, Measured, Stored, refuse_other_scenes
from spin_rl.reproduce.tables.table import Claim, Table, compare

_METHODS = {"NoPointNet": "nopointnet", "SPIN (DVO)": "dvo", "SPIN (CVO)": "cvo"}
"""Row of Table 1 -> name of its trainings that drive."""
_PARTS = ("pick", *(f"place S{scenario} {difficulty}" for scenario, difficulty in CELLS))


def place(stored: Stored) -> Table:
    """Success of picking, out of those that came to the table, and of placing, out of all fetches."""
    found = {label: stored.measured("fetch", name) for label, name in _METHODS.items()}
    stored.refuse_empty()
    methods = {label: method for label, method in found.items() if method.results}
    rows: list[tuple[str, ...]] = []
    records: list[Mapping[str, Any]] = []
    for label, method in methods.items():
        rates = [_pick(method), *(_pooled(_placed(method, cell)) for cell in CELLS)]
        paper = [PICK[label].success_rate, *(PLACE[label][cell].success_rate for cell in CELLS)]
        own = ["none tried" if rate is None else rate.text() for rate in rates]
        rows.append((label, "ours", *own, method.steps))
        rows.append((label, "paper", *(f"{figure:.2f}" for figure in paper), THEIRS))
        for part, rate, figure in zip(_PARTS, rates, paper, strict=True):
            about = {"method": label, "part": part, "paper_success_rate": figure, "trainings": method.steps}
            records.append(about | _figures(rate))
    results = [result for method in methods.values() for result in method.results]
    refuse_other_scenes("fetches", results)
    picks = sorted({kept["result"]["pick"] for kept in results})
    machines = sorted({kept["hardware"] for kept in results})
    return Table(
        "place",
        ("method", "figure", *_PARTS, "drive"),
        tuple(rows),
        tuple(records),
        claims=_claims(methods),
        notes=(
            budget_note(list(methods.values())),
            f"all pick with {', '.join(picks)}, which reads no scandots; pick: out of those that reached the "
            "table, place: out of all fetches",
            "nobody is told of the table: NoPointNet takes a fixed number of scandots, those of navigation",
            f"intervals: 95 %, over fetches, by Wilson's and of differences by Newcombe's method; "
            f"{'; '.join(machines)}, commits {known(kept['commit'] for kept in results)}",
            "a row again: `spin-reproduce run=true again=true only=fetch/<training>`; its command is in "
            "`results/fetch/<training>.json`",
        ),
        missing=stored.rest,
    )


def _pick(method: Measured) -> Rate | None:
    """Picking of all trainings together; None where nobody came to the table."""
    picks = [result["result"]["overall"]["pick"] for result in method.results]
    tried = sum(pick["tried"] for pick in picks)
    return Rate(sum(pick["succeeded"] for pick in picks), tried) if tried else None


def _placed(method: Measured, *cells: Cell) -> list[Rate]:
    """Placing in some cells, or in all, of each training."""
    return [
        _pooled(
            Rate(row["place"]["succeeded"], row["episodes"])
            for row in result["result"]["rows"]
            if not cells or (row["scenario"], row["difficulty"]) in cells
        )
        for result in method.results
    ]


def _pooled(rates: Iterable[Rate]) -> Rate:
    rates = list(rates)
    return Rate(sum(rate.successes for rate in rates), sum(rate.episodes for rate in rates))


def _figures(rate: Rate | None) -> dict[str, Any]:
    low, high = (None, None) if rate is None else rate.interval
    return {
        "success_rate": None if rate is None else rate.value,
        "ci95_low": low,
        "ci95_high": high,
        "episodes": 0 if rate is None else rate.episodes,
    }


def _claims(methods: Mapping[str, Measured]) -> tuple[Claim, ...]:
    one, other = "SPIN (CVO)", "NoPointNet"
    if not {one, other} <= methods.keys():
        return ()
    gap = sum(PLACE[one][cell].success_rate - PLACE[other][cell].success_rate for cell in CELLS) / len(CELLS)
    text = "placing, CVO over NoPointNet, all corridors"
    return (compare(text, _placed(methods[one]), _placed(methods[other]), paper=gap, wanted=0.10),)
