"""What a stored result must hold to be one: files can be cut off, edited, or from an older version."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Any

from spin_rl.benchmark.tables.paper import STATIC_DYNAMIC
from spin_rl.scenes.kinds import DIFFICULTIES, SCENARIOS

_KEPT: Mapping[str, type | tuple[type, ...]] = {
    "command": str,
    "step": dict,
    "commit": object,
    "hardware": str,
    "minutes": (float, int),
    "trainings": list,
    "result": dict,
}
"""What every stored result has; see `record.stored`."""
_CELLS = ("success_rate", "episodes", "outcomes")
_DRIVES = (
    *(*_CELLS, "scenario", "difficulty", "duration_s"),
    *("final_distance_m", "final_distance_ci95", "timeout_rate"),
)
_RESULTS: Mapping[str, tuple[str, ...]] = {
    **{kind: ("seeds", "commit", "num_envs") for kind in ("reach", "map_none", "map_small", "map_large")},
    "dynamic": ("seeds", "num_envs"),
    "fetch": ("overall", "pick", "seeds", "num_envs"),
}
"""Kind of results -> what tables read of one."""
_ROWS: Mapping[str, tuple[str, ...]] = {
    **{kind: _DRIVES for kind in ("reach", "map_none", "map_small", "map_large")},
    "dynamic": (*_CELLS, "scene", "obstacles", "ci95", "collisions", "collisions_ci95"),
    "fetch": ("success_rate", "episodes", "scenario", "difficulty", "reach", "pick", "place"),
    "speed": ("name", "value", "baseline_value"),
}
"""Kind of results -> what tables read of each of its rows."""
CORRIDORS: tuple[tuple[int, str], ...] = tuple(product(SCENARIOS, DIFFICULTIES))
"""The cells of the reach benchmark and of fetches: scenario and difficulty."""
CONDITIONS: tuple[tuple[str, str], ...] = tuple(STATIC_DYNAMIC)
"""Those of the benchmark with obstacles that move: scene and obstacles."""
_PLACES: Mapping[str, tuple[tuple[str, ...], tuple[tuple[Any, ...], ...]]] = {
    **{
        kind: (("scenario", "difficulty"), CORRIDORS)
        for kind in ("reach", "map_none", "map_small", "map_large", "fetch")
    },
    "dynamic": (("scene", "obstacles"), CONDITIONS),
}
"""Kind of results -> keys that name a row, and the rows that there must be."""


def lacking(name: str, stored: Any) -> str | None:
    """Say what a stored result lacks; None where it has all that is read of it.

    Args:
        name: Of the result, such as `reach/cvo-1`.
        stored: What its file holds.
    """
    kind = name.partition("/")[0]
    if not isinstance(stored, Mapping):
        return "everything"
    for key, wanted in _KEPT.items():
        if key not in stored or not isinstance(stored[key], wanted):
            return key
    result = stored["result"]
    for key in _RESULTS.get(kind, ()):
        if key not in result:
            return f"result.{key}"
    if kind not in _ROWS:
        return None
    rows = result.get("rows")
    if not isinstance(rows, list) or not rows:
        return "result.rows"
    for number, row in enumerate(rows):
        for key in _ROWS[kind]:
            if not isinstance(row, Mapping) or key not in row:
                return f"result.rows[{number}].{key}"
    if kind in _PLACES:
        keys, wanted = _PLACES[kind]
        there = {tuple(row[key] for key in keys) for row in rows}
        for place in wanted:
            if place not in there:
                return f"result.rows of {' '.join(map(str, place))}"
    return None
