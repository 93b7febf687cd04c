"""How narrow the place is where an episode failed."""

from __future__ import annotations

import numpy as np

from spin_rl.planning.distance_field import CEILING_M
from spin_rl.scenes.layout import Scene
from spin_rl.scenes.outline import outline

_SPACING_M = 0.02
_OPPOSITE_COS = -0.5  # within 60 degrees


def free_width(scene: Scene, base: np.ndarray, slot: int | None) -> float | None:
    """Free width of a place: from one thing across the base's point to the nearest one opposite.

    Opposite is within 60 degrees of straight away: the base's front is so near to its point that what its
    front corners meet on either side of a gap lies less than 180 degrees apart. In a gap that is too narrow
    it is the gap's width; where the robot clips a corner in passing, there is room on the other side.

    Args:
        scene: What stood where; only what is lower than the robot's top counts.
        base: Point of the base (x, y) [m].
        slot: The thing; None takes the nearest.

    Returns:
        The width [m], None where there is nothing opposite.
    """
    low = scene.active & (scene.pos[:, 2] - scene.half_size[:, 2] < CEILING_M)
    slots = np.flatnonzero(low) if slot is None else np.union1d(np.flatnonzero(low), slot)
    if not len(slots):
        return None
    outlines = [_points(outline(scene, int(other))) - base for other in slots]
    owner = np.repeat(slots, [len(points) for points in outlines])
    offset = np.concatenate(outlines)
    away = np.linalg.norm(offset, axis=1)
    own = int(np.argmin(away if slot is None else np.where(owner == slot, away, np.inf)))
    opposite = offset @ offset[own] <= _OPPOSITE_COS * away * away[own]
    return float(away[own] + away[opposite].min()) if opposite.any() else None


def _points(corners: np.ndarray) -> np.ndarray:
    """Points `_SPACING_M` apart or less on the sides of a polygon, shape (n, 2)."""
    sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    return np.concatenate(
        [np.linspace(a, b, int(np.linalg.norm(b - a) / _SPACING_M) + 2)[:-1] for a, b in sides]
    )
