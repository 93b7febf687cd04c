"""The pick and place columns of Table 1, for the methods that can fetch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from spin_rl.benchmark.metrics import wilson_interval
from spin_rl.benchmark.tables.paper import PICK, PLACE
from spin_rl.reproduce.tables.corridors import CELLS, THEIRS
from spin_rl.reproduce.tables.notes import INTERVALS, budget_note, known
from spin_rl.reproduce.tables.rates import Rate, rate_text
from spin_rl.reproduce.tables.stored import Cell, Measured, Stored, refuse_other_scenes
from spin_rl.reproduce.tables.table import Claim, Kind, Table, compare

_METHODS = {
    "NoPointNet": "nopointnet",
    "Mapping": "mapping",
    "SPIN (DVO)": "dvo",
    "SPIN (CVO)": "cvo",
}
"""Row of Table 1 -> name of its trainings that drive."""
_NOT_MEASURED = "FixCam"
"""Row of Table 1 that is the paper's alone: here both of a fetch's policies would have one camera."""
_ORDERINGS: Mapping[str, tuple[float, Kind]] = {
    "NoPointNet": (0.10, "more"),
    "Mapping": (0.0, "disputed"),
    "SPIN (DVO)": (0.0, "alike"),
}
"""What CVO is compared with, and what the paper finds, see `table.Claim`."""
_PARTS = ("pick", *(f"place S{scenario} {difficulty}" for scenario, difficulty in CELLS))


def place(stored: Stored) -> Table:
    """Picking, out of those that came to the table, and placing, out of all fetches: success and time."""
    found = {label: stored.measured("fetch", name) for label, name in _METHODS.items()}
    stored.refuse_empty()
    methods = {label: method for label, method in found.items() if method.results}
    rows: list[tuple[str, ...]] = []
    records: list[Mapping[str, Any]] = []
    for label, method in methods.items():
        placed = [method.rate(cell) for cell in CELLS]
        rates = [_pick(method), *placed]
        times = [_time(method, "pick", ()), *(_time(method, "place", (cell,)) for cell in CELLS)]
        paper = [PICK[label], *(PLACE[label][cell] for cell in CELLS)]
        rows += [
            (label, "ours", *("none tried" if rate is None else rate.text() for rate in rates), method.steps),
            (
                label,
                "each",
                _each_pick(method),
                *(rate.each_text() for rate in placed),
                method.steps,
            ),
            (label, "at the table", *_reached(method), method.steps),
            (label, "paper", *(f"{figure.success_rate:.2f}" for figure in paper), THEIRS),
            (label, "time", *("none" if time is None else f"{time:.1f} s" for time in times), method.steps),
            (label, "paper, time", *(f"{figure.duration_s:.2f} s" for figure in paper), THEIRS),
        ]
        for part, rate, time, figure in zip(_PARTS, rates, times, paper, strict=True):
            records.append(
                {
                    "method": label,
                    "part": part,
                    **_figures(rate),
                    "duration_s": time,
                    "paper_success_rate": figure.success_rate,
                    "paper_duration_s": figure.duration_s,
                    "trainings": method.steps,
                }
            )
    paper = [PICK[_NOT_MEASURED], *(PLACE[_NOT_MEASURED][cell] for cell in CELLS)]
    rows.append((_NOT_MEASURED, "paper", *(f"{figure.success_rate:.2f}" for figure in paper), THEIRS))
    rows.append((_NOT_MEASURED, "paper, time", *(f"{figure.duration_s:.2f} s" for figure in paper), THEIRS))
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
            "at the table: share of the fetches that came there; time: mean of the successes, of placing "
            "from the grasp on; the paper does not say whether failures count",
            f"intervals: 95 %, {INTERVALS}; {'; '.join(machines)}, commits "
            f"{known(kept['commit'] for kept in results)}",
            "a row again: `spin-reproduce run=true again=true only=fetch/<training>`; its command is in "
            "`results/fetch/<training>.json`",
        ),
        missing=stored.rest,
    )


@dataclass(frozen=True)
class _Pick:
    """Picking of all trainings together.

    It has the interval of as many fetches as one training had on average: trainings have the same fetches,
    and which of them came to a table is not stored.
    """

    succeeded: int
    episodes: int
    trainings: int

    @property
    def value(self) -> float:
        return self.succeeded / self.episodes

    @property
    def interval(self) -> tuple[float, float]:
        return wilson_interval(self.succeeded / self.trainings, self.episodes / self.trainings)

    def text(self) -> str:
        return rate_text(self.value, self.interval)


def _pick(method: Measured) -> _Pick | None:
    """Picking of all trainings together; None where nobody came to the table."""
    picks = _picks(method)
    tried = sum(pick["tried"] for pick in picks)
    return _Pick(sum(pick["succeeded"] for pick in picks), tried, len(picks)) if tried else None


def _each_pick(method: Measured) -> str:
    tried = [(pick["succeeded"], pick["tried"]) for pick in _picks(method)]
    return " ".join(f"{succeeded / count:.2f}" if count else "none" for succeeded, count in tried)


def _picks(method: Measured) -> list[Mapping[str, Any]]:
    return [result["result"]["overall"]["pick"] for result in method.results]


def _reached(method: Measured) -> list[str]:
    """Share of the fetches that came to the table: of all, and of each cell."""
    rows = [row for rows in method.rows() for row in rows]
    cells = [[row for row in rows if (row["scenario"], row["difficulty"]) == cell] for cell in CELLS]
    return [
        f"{sum(row['reach']['succeeded'] for row in some) / sum(row['episodes'] for row in some):.2f}"
        for some in (rows, *cells)
    ]


def _time(method: Measured, part: str, cells: Sequence[Cell]) -> float | None:
    """Mean time of a part of a fetch over those that succeeded in it [s]; None without one."""
    rows = [row for rows in method.rows() for row in rows]
    parts = [row[part] for row in rows if not cells or (row["scenario"], row["difficulty"]) in cells]
    done = [(part["succeeded"], part["duration_s"]) for part in parts if part["succeeded"]]
    count = sum(succeeded for succeeded, _ in done)
    return sum(succeeded * time for succeeded, time in done) / count if count else None


def _figures(rate: Rate | _Pick | None) -> dict[str, Any]:
    low, high = (None, None) if rate is None else rate.interval
    return {
        "success_rate": None if rate is None else rate.value,
        "ci95_low": low,
        "ci95_high": high,
        "episodes": 0 if rate is None else rate.episodes,
    }


def _claims(methods: Mapping[str, Measured]) -> tuple[Claim, ...]:
    own = "SPIN (CVO)"
    claims: list[Claim] = []
    for other, (wanted, kind) in _ORDERINGS.items():
        if {own, other} <= methods.keys():
            gaps = [PLACE[own][cell].success_rate - PLACE[other][cell].success_rate for cell in CELLS]
            text = f"placing, CVO over {other.removeprefix('SPIN ').strip('()')}, all corridors"
            rates = methods[own].rate(), methods[other].rate()
            claims.append(compare(text, *rates, paper=sum(gaps) / len(gaps), wanted=wanted, kind=kind))
    return tuple(claims)
