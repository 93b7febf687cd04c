"""Terminal table of a benchmark in another simulator beside the batched run of the same episodes."""

from __future__ import annotations

from typing import Any

from spin_rl.benchmark.tables.reach import align, figures, main_causes, title

_CONDITIONS = ("scenario", "difficulty", "family", "scene", "object")
MUJOCO = "mujoco"
BACKENDS = {MUJOCO: "C MuJoCo"}
"""Other simulators, with their names in tables."""


def table(result: dict[str, Any]) -> str:
    """Format a result of `backend.evaluate_again` for the terminal."""
    counts = sorted({row["episodes"] for row in result["rows"]})
    episodes = f"{' or '.join(map(str, counts))} episodes per row"
    simulator = f"{BACKENDS[result['backend']]} at {result['timestep_s']:g} s, images by {result['renderer']}"
    heading = f"{title(result['benchmark'].capitalize(), result, episodes)}; exported, {simulator}"
    header = [
        "",
        "success",
        "95%",
        "time",
        "batched",
        "difference",
        "95%",
        "won",
        "lost",
        "failures by cause",
    ]
    body = []
    for name, row in [*((_name(row), row) for row in result["rows"]), ("all", result["overall"])]:
        difference = row["difference"]
        low, high = difference["ci95"]
        body.append(
            [
                name,
                *figures(row),
                f"{row['batched']['success_rate']:.2f}",
                f"{difference['mean']:+.3f}",
                f"{low:+.3f} to {high:+.3f}",
                str(difference["won"]),
                str(difference["lost"]),
                main_causes(row),
            ]
        )
    note = "difference: to the batched run of the same episodes; won, lost: successes here, there alone"
    return "\n".join([heading, *align([header, *body]), note])


def headline(result: dict[str, Any]) -> str:
    """One line that sums a result up."""
    row = result["overall"]
    low, high = row["difference"]["ci95"]
    return (
        f"success {row['success_rate']:.3f}, batched {row['batched']['success_rate']:.3f}, "
        f"difference {low:+.3f} to {high:+.3f} in {row['episodes']} episodes"
    )


def _name(row: dict[str, Any]) -> str:
    return " ".join(str(row[key]) for key in _CONDITIONS if key in row)
