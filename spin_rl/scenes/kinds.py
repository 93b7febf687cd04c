"""Names of what a generated scene and its obstacles are."""

from __future__ import annotations

from typing import Any

from spin_rl.config import ConfigError
from spin_rl.scenes.layout import Scene

FAMILIES = ("corridor", "room", "doorway", "field", "crossing", "open", "shuttle")
"""Kinds of places, in the order of `Layout.family`."""

SCENARIO_NAMES = {1: "straight", 2: "L"}
SCENARIOS = tuple(SCENARIO_NAMES)
"""A straight corridor and an L-shaped one."""

DIFFICULTIES = ("easy", "medium", "hard")
"""In the order of the generator's numbers, from 0."""

CHOICES = {
    "scenario": {"any": 0, **{name: number for number, name in SCENARIO_NAMES.items()}},
    "difficulty": {"any": -1, **{name: number for number, name in enumerate(DIFFICULTIES)}},
}
"""Names of the values of `task.scenario` and `task.difficulty` -> the generator's numbers; `any` is a mix."""

LEVELS = ("low", "tall", "arm", "head")
"""Obstacles that the arm passes over, none passes, stand at the arm's height, hang at the head's."""

_ON_FLOOR_M = 0.05
_LOW_TOP_M = 0.4
_HEAD_BOTTOM_M = 0.95


def number_of(what: str, value: Any, where: str) -> Any:
    """Turn a name of `CHOICES` into its number; other values stay as they are.

    Args:
        what: "scenario" or "difficulty".
        value: Such as "hard" or 2.
        where: What the message calls it.

    Raises:
        ConfigError: A name that is none.
    """
    names = CHOICES[what]
    if not isinstance(value, str):
        return value
    if value not in names:
        raise ConfigError(f"{where}: unknown {value!r}; choose from {', '.join(names)}")
    return names[value]


def level_of(bottom: float, top: float) -> str:
    """Name of `LEVELS` for an obstacle between two heights [m].

    Floating obstacles from 0.95 m up are at the head's height; those on the floor are low up to 0.4 m.
    """
    if bottom > _HEAD_BOTTOM_M:
        return "head"
    if bottom > _ON_FLOOR_M:
        return "arm"
    return "low" if top <= _LOW_TOP_M else "tall"


def levels(scene: Scene) -> list[str]:
    """Level of every slot; that of walls and inactive slots means nothing."""
    bottoms, tops = scene.pos[:, 2] - scene.half_size[:, 2], scene.pos[:, 2] + scene.half_size[:, 2]
    return [level_of(float(bottom), float(top)) for bottom, top in zip(bottoms, tops, strict=True)]
