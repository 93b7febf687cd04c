"""Scenes without what hangs or lies flat: all obstacles stand on the floor and cross the plane of a lidar."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from spin_rl.scenes.layout import Scene

LEAST_HEIGHT_M = 0.3
"""Of everything: a lidar on the base sees it."""


def grounded(scene: Scene, ceiling_m: float) -> Scene:
    """Extend everything down to the floor, and what is flat up to `LEAST_HEIGHT_M`.

    Args:
        scene: Any scene; not changed.
        ceiling_m: What hangs from here on [m] hinders nobody and stays.
    """
    bottom = scene.pos[:, 2] - scene.half_size[:, 2]
    top = scene.pos[:, 2] + scene.half_size[:, 2]
    changed = scene.active & (bottom < ceiling_m)
    half_height = 0.5 * np.where(changed, np.maximum(top, LEAST_HEIGHT_M), 0.0)
    pos, half, home = scene.pos.copy(), scene.half_size.copy(), scene.home.copy()
    for heights in (pos, half, home):
        heights[changed, 2] = half_height[changed]
    return replace(scene, pos=pos, half_size=half, home=home)
