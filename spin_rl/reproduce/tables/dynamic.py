"""The table of static and dynamic obstacles: learned policies against the classical stack."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from spin_rl.benchmark.tables.paper import STATIC_DYNAMIC
from spin_rl.reproduce.tables.rates import Rate
from spin_rl.reproduce.tables.stored import Stored, known
from spin_rl.reproduce.tables.table import Claim, Table, compare

_POLICIES = {"nav-room": "SPIN", "nav-cvo": "SPIN", "classical": "Classical"}
"""What acts -> its method in the paper."""
_SCENES = {"lab": 1, "study": 2}
"""Scene -> its number in the paper."""
_OBSTACLES = ("static", "dynamic")
CONDITIONS = tuple((scene, obstacles) for scene in _SCENES for obstacles in _OBSTACLES)


def dynamic(stored: Stored) -> Table:
    """Success and number of collisions in the paper's two places, with and without an obstacle that moves."""
    results = {policy: stored.result(f"dynamic/{policy}") for policy in _POLICIES}
    found = {
        policy: {(row["scene"], row["obstacles"]): row for row in result["result"]["rows"]}
        for policy, result in results.items()
    }
    rows: list[tuple[str, ...]] = []
    records: list[Mapping[str, Any]] = []
    for policy, method in _POLICIES.items():
        cells = [found[policy][condition] for condition in CONDITIONS]
        paper = [STATIC_DYNAMIC[_SCENES[scene], obstacles][method] for scene, obstacles in CONDITIONS]
        rows.append(
            (policy, "success", *(Rate.of([row]).text() for row in cells), results[policy]["command"])
        )
        rows.append(("", f"paper, {method}", *(f"{figure.success_rate:.1f}" for figure in paper), ""))
        rows.append(("", "collisions", *(f"{row['collisions']:.2f}" for row in cells), ""))
        rows.append(("", f"paper, {method}", *(f"{figure.collisions:.1f}" for figure in paper), ""))
        for (scene, obstacles), row, figure in zip(CONDITIONS, cells, paper, strict=True):
            low, high = row["ci95"]
            records.append(
                {
                    "policy": policy,
                    "scene": scene,
                    "obstacles": obstacles,
                    "success_rate": row["success_rate"],
                    "ci95_low": low,
                    "ci95_high": high,
                    "episodes": row["episodes"],
                    "collisions": row["collisions"],
                    "paper_success_rate": figure.success_rate,
                    "paper_collisions": figure.collisions,
                }
            )
    commits = known(result["commit"] for result in results.values())
    machines = sorted({result["hardware"] for result in results.values()})
    return Table(
        "dynamic",
        "Static and dynamic obstacles: success within 15 cm and collisions, paper's below",
        ("policy", "", *(f"{scene} {obstacles}" for scene, obstacles in CONDITIONS), "command"),
        tuple(rows),
        tuple(records),
        claims=tuple(_claim(found, obstacles) for obstacles in _OBSTACLES),
        notes=(
            "simulated counterparts of the paper's real places; an episode goes on after a collision",
            f"intervals: 95 %, over episodes; {'; '.join(machines)}, commits {commits}",
        ),
    )


def _claim(found: Mapping[str, Mapping[Any, Any]], obstacles: str) -> Claim:
    """Learned over classical with one kind of obstacles, both places together."""

    def rate(policy: str) -> Rate:
        return Rate.of(found[policy][scene, obstacles] for scene in _SCENES)

    paper = [STATIC_DYNAMIC[number, obstacles] for number in _SCENES.values()]
    gap = sum(place["SPIN"].success_rate - place["Classical"].success_rate for place in paper) / len(paper)
    best = max(
        (rate(policy) for policy, method in _POLICIES.items() if method == "SPIN"), key=lambda r: r.value
    )
    text = f"learned (the better one) over classical, {obstacles} obstacles"
    return compare(text, [best], [rate("classical")], paper=gap, wanted=0.2)
