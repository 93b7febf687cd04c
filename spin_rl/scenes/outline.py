"""What a slot of a scene covers of the floor, seen from above."""

from __future__ import annotations

import numpy as np

from spin_rl.scenes.layout import Scene

_ANGLES = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
UNIT_CIRCLE = np.stack((np.cos(_ANGLES), np.sin(_ANGLES)), -1)
"""Points of a circle, counter-clockwise, shape (24, 2)."""

_SQUARE = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])


def outline(scene: Scene, slot: int) -> np.ndarray:
    """Corners of a slot seen from above [m], counter-clockwise, shape (n, 2)."""
    local = (UNIT_CIRCLE if scene.is_cylinder[slot] else _SQUARE) * scene.half_size[slot, :2]
    cos, sin = np.cos(scene.yaw[slot]), np.sin(scene.yaw[slot])
    return scene.pos[slot, :2] + local @ np.array([[cos, sin], [-sin, cos]])


def distance_to(polygon: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distance of points to a convex polygon, across the floor.

    Args:
        polygon: Its corners [m], counter-clockwise, shape (m, 2).
        points: Positions [m], shape (n, 2).

    Returns:
        Distances [m], 0 inside, shape (n,).
    """
    start = polygon[None]
    edge = np.roll(polygon, -1, axis=0)[None] - start
    offset = points[:, None] - start
    share = np.clip((offset * edge).sum(-1) / (edge**2).sum(-1), 0.0, 1.0)
    distance = np.linalg.norm(offset - share[..., None] * edge, axis=-1).min(1)
    inside = (edge[..., 0] * offset[..., 1] - edge[..., 1] * offset[..., 0] >= 0.0).all(1)
    return np.where(inside, 0.0, distance)
