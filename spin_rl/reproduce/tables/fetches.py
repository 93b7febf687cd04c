"""The pick and place columns of Table 1, for the methods that can fetch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from spin_rl.benchmark.tables.paper import PICK, PLACE
from spin_rl.reproduce.tables.corridors import CELLS
from spin_rl.reproduce.tables.rates import Rate
from spin_rl.reproduce.tables.stored import Measured, Stored, budget_note, known
from spin_rl.reproduce.tables.table import Table, compare

_METHODS = {"NoPointNet": "nopointnet-1", "SPIN (DVO)": "dvo-1", "SPIN (CVO)": "cvo-1"}
"""Row of Table 1 -> its training that drives."""


def place(stored: Stored) -> Table:
    """Success of picking, out of those that came to the table, and of placing, out of all fetches."""
    results = {label: stored.result(f"fetch/{name}") for label, name in _METHODS.items()}
    rows: list[tuple[str, ...]] = []
    records: list[Mapping[str, Any]] = []
    placed: dict[str, Rate] = {}
    for label, kept in results.items():
        result = kept["result"]
        own = {(row["scenario"], row["difficulty"]): row for row in result["rows"]}
        pick = result["overall"]["pick"]
        rates = [Rate(pick["succeeded"], pick["tried"])]
        rates += [Rate(own[cell]["place"]["succeeded"], own[cell]["episodes"]) for cell in CELLS]
        placed[label] = Rate(
            sum(rate.successes for rate in rates[1:]), sum(rate.episodes for rate in rates[1:])
        )
        paper = [PICK[label].success_rate, *(PLACE[label][cell].success_rate for cell in CELLS)]
        rows.append((label, "ours", *(rate.text() for rate in rates), kept["trainings"][0]["name"]))
        rows.append(("", "paper", *(f"{figure:.2f}" for figure in paper), ""))
        parts = ["pick", *(f"place S{scenario} {difficulty}" for scenario, difficulty in CELLS)]
        for part, rate, figure in zip(parts, rates, paper, strict=True):
            low, high = rate.interval
            records.append(
                {
                    "method": label,
                    "part": part,
                    "success_rate": rate.value,
                    "ci95_low": low,
                    "ci95_high": high,
                    "episodes": rate.episodes,
                    "paper_success_rate": figure,
                    "command": kept["command"],
                }
            )
    first = next(iter(results.values()))
    mean = {label: sum(PLACE[label][cell].success_rate for cell in CELLS) / len(CELLS) for label in _METHODS}
    return Table(
        "place",
        "Table 1, pick and place: success, paper's below",
        ("method", "", "pick", *(f"S{scenario} {difficulty}" for scenario, difficulty in CELLS), "drives"),
        tuple(rows),
        tuple(records),
        claims=(
            compare(
                "placing, CVO over NoPointNet, all corridors",
                [placed["SPIN (CVO)"]],
                [placed["NoPointNet"]],
                paper=mean["SPIN (CVO)"] - mean["NoPointNet"],
                wanted=0.10,
            ),
        ),
        notes=(
            budget_note([Measured(label, (kept,)) for label, kept in results.items()]),
            f"all pick with {first['result']['pick']}, which reads no scandots; pick: out of those that "
            "reached the table, place: out of all fetches",
            "FixCam and Mapping have no row: a fetch moves the camera by itself and has no map",
            f"intervals: 95 %, over fetches; {first['hardware']}, "
            f"commits {known(kept['commit'] for kept in results.values())}",
        ),
    )
