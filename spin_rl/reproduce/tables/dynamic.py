"""The table of static and dynamic obstacles: learned policies against the classical stack."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from spin_rl.benchmark.tables.paper import STATIC_DYNAMIC, PaperPlace
from spin_rl.reproduce.contents import CONDITIONS
from spin_rl.reproduce.tables.corridors import THEIRS
from spin_rl.reproduce.tables.notes import INTERVALS, known, span
from spin_rl.reproduce.tables.rates import Rate
from spin_rl.reproduce.tables.stored import Stored, refuse_other_scenes
from spin_rl.reproduce.tables.table import Claim, Table, compare

_CLASSICAL = ("classical", "classical_60s", "classical_map")
"""Opponents, the one with as much time first."""
_OBSTACLES = tuple(dict.fromkeys(obstacles for _, obstacles in CONDITIONS))
_POLICIES = {
    "nav-room": ("nav-room, guard and planner", "SPIN"),
    "alone_nav-room": ("nav-room, its network alone", "SPIN"),
    "nav-cvo": ("nav-cvo, corridors only", "SPIN"),
    "classical": ("classical", "Classical"),
    "classical_60s": ("classical, 60 s of slack", "Classical"),
    "classical_map": ("classical, by the map alone", "Classical"),
}
"""Name of a result -> what acts, and its method in the paper."""


def dynamic(stored: Stored) -> Table:
    """Success and number of collisions in the paper's two places, with and without an obstacle that moves."""
    stored_of = {policy: stored.find(f"dynamic/{policy}") for policy in _POLICIES}
    stored.refuse_empty()
    results = {policy: result for policy, result in stored_of.items() if result is not None}
    refuse_other_scenes("policies", results.values())
    found = {
        policy: {(row["scene"], row["obstacles"]): row for row in result["result"]["rows"]}
        for policy, result in results.items()
    }
    rows: list[tuple[str, ...]] = []
    records: list[Mapping[str, Any]] = []
    for policy, own in found.items():
        label, method = _POLICIES[policy]
        cells = [own[condition] for condition in CONDITIONS]
        paper = [STATIC_DYNAMIC[condition][method] for condition in CONDITIONS]
        command = f"`{results[policy]['command']}`"
        rows += [
            (label, "success", *(Rate.of([[row]]).text() for row in cells), command),
            (
                label,
                f"success, paper's {method}",
                *(f"{figure.success_rate:.1f}" for figure in paper),
                THEIRS,
            ),
            (label, "collisions", *map(_collisions, cells), command),
            (
                label,
                f"collisions, paper's {method}",
                *(f"{figure.collisions:.1f}" for figure in paper),
                THEIRS,
            ),
        ]
        records += [_record(policy, row, figure) for row, figure in zip(cells, paper, strict=True)]
    commits = known(result["commit"] for result in results.values())
    machines = sorted({result["hardware"] for result in results.values()})
    episodes = sorted({row["episodes"] for own in found.values() for row in own.values()})
    return Table(
        "dynamic",
        ("policy", "figure", *(f"{scene} {obstacles}" for scene, obstacles in CONDITIONS), "command"),
        tuple(rows),
        tuple(records),
        claims=tuple(claim for obstacles in _OBSTACLES for claim in _claims(found, obstacles)),
        notes=(
            *_notes_of_collisions(found),
            f"{span(episodes)} episodes a cell; intervals: 95 %, {INTERVALS}; of collisions a "
            f"bootstrap; {'; '.join(machines)}, commits {commits}",
            "the paper's policy was not trained with dynamic obstacles; of these, nav-cvo was not, which "
            "knows corridors alone, and nav-room was, in crossings and with walkers in 30 % of its rooms",
            "no equal terms: nav-room drives at up to 0.8 m/s by boxes that it has seen and its exact "
            "position, and other trips through these two places helped to choose the settings of its guard; "
            "the classical stack drives at up to 0.6 m/s by a lidar, with errors of odometry, start and "
            "execution, and was tuned elsewhere",
            "an episode has 10 s and three times the time of its way at 0.8 m/s; with 60 s of slack the "
            "classical stack has time for its detours",
            "samples and times of the shipped policies' trainings: `policies/nav-room.md`, "
            "`policies/nav-cvo.md`; the classical stack learns nothing",
        ),
        missing=stored.rest,
    )


def _collisions(row: Mapping[str, Any]) -> str:
    low, high = row["collisions_ci95"]
    return f"{row['collisions']:.2f} ({low:.2f}-{high:.2f})"


def _record(policy: str, row: Mapping[str, Any], paper: PaperPlace) -> dict[str, Any]:
    return {
        "policy": policy,
        "scene": row["scene"],
        "obstacles": row["obstacles"],
        "success_rate": row["success_rate"],
        "ci95_low": row["ci95"][0],
        "ci95_high": row["ci95"][1],
        "episodes": row["episodes"],
        "collisions": row["collisions"],
        "collisions_ci95_low": row["collisions_ci95"][0],
        "collisions_ci95_high": row["collisions_ci95"][1],
        "paper_success_rate": paper.success_rate,
        "paper_collisions": paper.collisions,
    }


def _claims(found: Mapping[str, Mapping[Any, Any]], obstacles: str) -> tuple[Claim, ...]:
    """Each learned policy over classical with one kind of obstacles, both places together."""
    conditions = [condition for condition in CONDITIONS if condition[1] == obstacles]

    def rate(policy: str) -> Rate:
        return Rate.of([[found[policy][condition] for condition in conditions]])

    paper = [STATIC_DYNAMIC[condition] for condition in conditions]
    gap = _mean(place["SPIN"].success_rate - place["Classical"].success_rate for place in paper)
    return tuple(
        compare(
            f"{label} over {_POLICIES[opponent][0]}, {obstacles} obstacles",
            rate(policy),
            rate(opponent),
            paper=gap,
            wanted=0.2,
        )
        for opponent in _CLASSICAL
        for policy, (label, method) in _POLICIES.items()
        if method == "SPIN" and {policy, opponent} <= found.keys()
    )


def _notes_of_collisions(found: Mapping[str, Mapping[Any, Any]]) -> Iterator[str]:
    """Collisions of each with one kind of obstacles, both places together, beside the paper's."""
    for obstacles in _OBSTACLES:
        conditions = [condition for condition in CONDITIONS if condition[1] == obstacles]
        ours = [
            f"{_POLICIES[policy][0]} {_mean(own[condition]['collisions'] for condition in conditions):.2f}"
            for policy, own in found.items()
        ]
        paper = [
            f"{method} {_mean(STATIC_DYNAMIC[condition][method].collisions for condition in conditions):.1f}"
            for method in ("SPIN", "Classical")
        ]
        yield f"collisions with {obstacles} obstacles: {'; '.join(ours)}; the paper's {'; '.join(paper)}"


def _mean(values: Iterable[float]) -> float:
    every = list(values)
    return sum(every) / len(every)
