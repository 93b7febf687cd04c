"""The pick and place columns of Table 1, for the methods that can fetch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from spin_rl.benchmark.tables.paper import PICK, PLACE
from spin_rl.reproduce.tables.corridors import CELLS, THEIRS
from spin_rl.reproduce.tables.notes import budget_note, known
from spin_rl.reproduce.tables.rates import Rate
from spin_rl.reproduce.tables.stored import Measured, Stored
from spin_rl.reproduce.tables.table import Claim, Table, compare

_METHODS = {"NoPointNet": "nopointnet-1", "SPIN (DVO)": "dvo-1", "SPIN (CVO)": "cvo-1"}
"""Row of Table 1 -> its training that drives."""
_PARTS = ("pick", *(f"place S{scenario} {difficulty}" for scenario, difficulty in CELLS))


def place(stored: Stored) -> Table:
    """Success of picking, out of those that came to the table, and of placing, out of all fetches."""
    found = {label: stored.find(f"fetch/{name}") for label, name in _METHODS.items()}
    stored.refuse_empty()
    results = {label: result for label, result in found.items() if result is not None}
    rows: list[tuple[str, ...]] = []
    records: list[Mapping[str, Any]] = []
    placed: dict[str, Rate] = {}
    for label, kept in results.items():
        pick, places = _rates(kept["result"])
        placed[label] = Rate(sum(p.successes for p in places), sum(p.episodes for p in places))
        paper = [PICK[label].success_rate, *(PLACE[label][cell].success_rate for cell in CELLS)]
        own = ["none tried" if rate is None else rate.text() for rate in (pick, *places)]
        rows.append((label, "ours", *own, kept["trainings"][0]["name"]))
        rows.append((label, "paper", *(f"{figure:.2f}" for figure in paper), THEIRS))
        for part, rate, figure in zip(_PARTS, (pick, *places), paper, strict=True):
            about = {"method": label, "part": part, "paper_success_rate": figure, "command": kept["command"]}
            records.append(about | _figures(rate))
    picks = sorted({kept["result"]["pick"] for kept in results.values()})
    machines = sorted({kept["hardware"] for kept in results.values()})
    return Table(
        "place",
        ("method", "figure", *_PARTS, "drives"),
        tuple(rows),
        tuple(records),
        claims=_claims(placed),
        notes=(
            budget_note([Measured(label, (kept,)) for label, kept in results.items()]),
            f"all pick with {', '.join(picks)}, which reads no scandots; pick: out of those that reached the "
            "table, place: out of all fetches",
            "NoPointNet takes a fixed number of scandots, those of navigation: it is not told of the table",
            f"intervals: 95 %, over fetches, by Wilson's and of differences by Newcombe's method; "
            f"{'; '.join(machines)}, commits {known(kept['commit'] for kept in results.values())}",
            "a row again: `spin-reproduce run=true only=fetch/<training>`; its command is in "
            "`results/fetch/<training>.json`",
        ),
        missing=stored.rest,
    )


def _rates(result: Mapping[str, Any]) -> tuple[Rate | None, Sequence[Rate]]:
    """Of picking, None where nobody came to the table, and of placing in every cell."""
    own = {(row["scenario"], row["difficulty"]): row for row in result["rows"]}
    pick = result["overall"]["pick"]
    places = [Rate(own[cell]["place"]["succeeded"], own[cell]["episodes"]) for cell in CELLS]
    return Rate(pick["succeeded"], pick["tried"]) if pick["tried"] else None, places


def _figures(rate: Rate | None) -> dict[str, Any]:
    low, high = (None, None) if rate is None else rate.interval
    return {
        "success_rate": None if rate is None else rate.value,
        "ci95_low": low,
        "ci95_high": high,
        "episodes": 0 if rate is None else rate.episodes,
    }


def _claims(placed: Mapping[str, Rate]) -> tuple[Claim, ...]:
    one, other = "SPIN (CVO)", "NoPointNet"
    if not {one, other} <= placed.keys():
        return ()
    mean = {name: sum(PLACE[name][cell].success_rate for cell in CELLS) / len(CELLS) for name in placed}
    text = "placing, CVO over NoPointNet, all corridors"
    gap = mean[one] - mean[other]
    return (compare(text, [placed[one]], [placed[other]], paper=gap, wanted=0.10),)
