"""Colours that all views share."""

from __future__ import annotations

import numpy as np

from spin_rl.scenes.kinds import levels
from spin_rl.scenes.layout import Scene

Rgb = tuple[int, int, int]

FLOOR: Rgb = (214, 217, 220)
WALL: Rgb = (158, 164, 172)
GOAL: Rgb = (46, 168, 92)
FRUSTUM: Rgb = (255, 176, 32)
SEEN: Rgb = (230, 40, 60)
UNSEEN: Rgb = (96, 108, 128)
INK: Rgb = (28, 32, 38)
PAPER: Rgb = (246, 247, 248)
ROBOT: Rgb = (40, 44, 52)
OUTCOME: dict[str, Rgb] = {
    "running": INK,
    "success": GOAL,
    "collision": (206, 44, 52),
    "timeout": (196, 126, 20),
    "non_finite": (140, 40, 160),
    "dropped": (150, 84, 40),
}

LEVEL: dict[str, Rgb] = {
    "low": (86, 140, 190),
    "tall": (120, 96, 160),
    "arm": (80, 160, 150),
    "head": (214, 138, 92),
}


def slot_colours(scene: Scene) -> list[Rgb]:
    """Colour of every slot: one for walls, one for each level of the obstacles."""
    return [WALL if wall else LEVEL[level] for wall, level in zip(scene.is_wall, levels(scene), strict=True)]


def scandot_colours(seen: np.ndarray) -> np.ndarray:
    """Colours of scandots, seen or not, shape (n, 3), uint8."""
    return np.where(seen[:, None], np.array(SEEN), np.array(UNSEEN)).astype(np.uint8)
