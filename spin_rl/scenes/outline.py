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
