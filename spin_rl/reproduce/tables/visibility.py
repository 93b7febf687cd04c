"""The table of visibility ranges."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from spin_rl.benchmark.tables.paper import VISIBILITY
from spin_rl.reproduce.tables.notes import COMMANDS, budget_note, episodes_note
from spin_rl.reproduce.tables.stored import Measured, Stored
from spin_rl.reproduce.tables.table import Claim, Kind, Table, compare

_TRAININGS = {1: "visibility_1", 2: "cvo", 3: "visibility_3", 5: "visibility_5"}
"""Range [m] -> name of its trainings."""
_ORDERINGS: tuple[tuple[int, int, Kind], ...] = ((2, 5, "more"), (1, 2, "alike"))
"""Ranges [m] that the paper compares, and what it finds."""
_HEADER = (
    *("range", "success", "each", "success, paper's"),
    *("distance", "distance, paper's", "time-outs", "trainings"),
)


def visibility(stored: Stored) -> Table:
    """Success and final distance to the goal by the range that the robot sees, mean of all six corridors."""
    methods = stored.reach(_TRAININGS)
    stored.refuse_empty()
    rows: list[tuple[str, ...]] = []
    records: list[Mapping[str, Any]] = []
    for metres, method in methods.items():
        rate, paper = method.rate(), VISIBILITY[metres]
        distance, nearest, farthest = method.final_distance()
        timeouts = method.mean("timeout_rate") or 0.0
        rows.append(
            (
                f"{metres} m",
                rate.text(),
                rate.each_text(),
                f"{paper.success_rate:.2f}",
                f"{distance:.2f} m ({nearest:.2f}-{farthest:.2f})",
                f"{paper.final_distance_m:.2f} m",
                f"{timeouts:.3f}",
                method.steps,
            )
        )
        low, high = rate.interval
        records.append(
            {
                "range_m": metres,
                "success_rate": rate.value,
                "ci95_low": low,
                "ci95_high": high,
                "episodes": rate.episodes,
                "each_training": " ".join(f"{each:.4f}" for each in rate.each),
                "paper_success_rate": paper.success_rate,
                "final_distance_m": distance,
                "final_distance_ci95_low": nearest,
                "final_distance_ci95_high": farthest,
                "paper_final_distance_m": paper.final_distance_m,
                "timeout_rate": timeouts,
                "trainings": method.steps,
            }
        )
    every = list(methods.values())
    return Table(
        "visibility",
        _HEADER,
        tuple(rows),
        tuple(records),
        claims=_claims(methods),
        notes=(
            budget_note(every),
            f"{episodes_note(every)}; of distances a bootstrap over episodes in every cell",
            COMMANDS,
        ),
        missing=stored.rest,
    )


def _claims(methods: Mapping[int, Measured]) -> tuple[Claim, ...]:
    claims: list[Claim] = []
    for one, other, kind in _ORDERINGS:
        if {one, other} <= methods.keys():
            gap = VISIBILITY[one].success_rate - VISIBILITY[other].success_rate
            rates = methods[one].rate(), methods[other].rate()
            claims.append(compare(f"{one} m over {other} m", *rates, paper=gap, kind=kind))
    return tuple(claims)
