"""Terminal tables of the benchmarks of places: scene families, and scene files with random trips."""

from __future__ import annotations

from typing import Any

from spin_rl.benchmark.tables.reach import align, figures, main_causes, notes, title


def table(result: dict[str, Any]) -> str:
    """Format a result of `rooms.evaluate_rooms` for the terminal."""
    return place_table("Rooms", "family", result)


def scenes_table(result: dict[str, Any]) -> str:
    """Format a result of `scenes.evaluate_scenes` for the terminal."""
    return place_table("Scenes", "scene", result)


def place_table(benchmark: str, place: str, result: dict[str, Any]) -> str:
    """Format rows that are each about a place, named by a key.

    Args:
        benchmark: Name of the benchmark.
        place: The key.
        result: Its result.
    """
    heading = title(benchmark, result, f"{result['rows'][0]['episodes']} episodes per {place}")
    header = [place, "success", "95%", "time", "SPL", "failures by cause"]
    body = [[row[place], *figures(row), f"{row['spl']:.2f}", main_causes(row)] for row in result["rows"]]
    spl = "SPL: success weighted by the shortest way over the path driven"
    return "\n".join([heading, *align([header, *body]), f"{notes(result, in_paper=False)}; {spl}"])


def headline(result: dict[str, Any]) -> str:
    """One line that sums a result up."""
    rows = result["rows"]
    mean = {key: sum(row[key] for row in rows) / len(rows) for key in ("success_rate", "spl")}
    return (
        f"mean success {mean['success_rate']:.2f}, SPL {mean['spl']:.2f} over {len(rows)} places, "
        f"{sum(row['episodes'] for row in rows)} episodes"
    )
