"""What the analysis calls things: what was hit, where the base was and what it did."""

from __future__ import annotations

import math

import numpy as np

from spin_rl.analysis.hits import FLOOR
from spin_rl.scenes.kinds import level_of
from spin_rl.scenes.layout import Scene

HITS = {"low": "low", "tall": "tall", "arm": "arm-height", "head": "head-height"}
"""Kinds of obstacles that stand still by the name of their level."""

OBSTACLES = (*HITS.values(), "mover")
"""Kinds of what was hit that are obstacles; the others are `wall`, `distractor` and `floor`."""

# Slower than this counts as not moving: of the base's fastest, 6 % forward and 7 % turning.
_STILL_M_S = 0.05
_STILL_RAD_S = 0.1


def kind_of(scene: Scene, slot: int) -> str:
    """Name what a slot is: one of `OBSTACLES`, `wall`, `distractor` or `floor`.

    The paper's corridors have distractors, outside of their walls: obstacles take the first box slots,
    distractors the last.
    """
    if slot == FLOOR:
        return "floor"
    if scene.is_wall[slot]:
        return "wall"
    boxes = scene.num_obstacles - int(np.count_nonzero(scene.active & scene.is_cylinder))
    if scene.scenario and not scene.is_cylinder[slot] and slot >= scene.pool.first_box + boxes:
        return "distractor"
    if scene.motion_speed[slot] > 0.0:
        return "mover"
    height, half = scene.pos[slot, 2], scene.half_size[slot, 2]
    return HITS[level_of(float(height - half), float(height + half))]


def place_of(scene: Scene, point: np.ndarray) -> str | None:
    """Name the part of one of the paper's corridors that a point (x, y) [m] is in; None in other scenes."""
    if scene.scenario == 0:
        return None
    if scene.bend == 0:
        return "straight"
    outer = 1  # slot of the first leg's outer wall, which bounds the free space at y = -+ half the width
    half_width = abs(scene.pos[outer, 1]) - scene.half_size[outer, 1]
    if abs(point[1]) > half_width:
        return "behind corner"
    return "before corner" if point[0] < scene.goal[0] - half_width else "in corner"


def base_velocity(qpos: np.ndarray, qvel: np.ndarray) -> tuple[float, float]:
    """Return the base's forward [m/s] and turning speed [rad/s] of a state."""
    return float(qvel[0] * np.cos(qpos[2]) + qvel[1] * np.sin(qpos[2])), float(qvel[2])


def motion_of(forward: float, turn: float) -> str:
    """Name what a base with a forward [m/s] and a turning speed [rad/s] does."""
    if abs(forward) >= _STILL_M_S:
        return "forward" if forward > 0.0 else "backward"
    return "turning" if abs(turn) >= _STILL_RAD_S else "still"


def manner_of(driven: float, turned: float, duration: float) -> str:
    """Name what a base did for a while.

    Args:
        driven: Way that it went [m].
        turned: By how much it turned, turns to and fro cancelling out [rad].
        duration: For how long [s].

    Returns:
        `circled` where it went all the way round, `spun` where it did so in place, else `drove` or `stood`.
    """
    moved = driven >= _STILL_M_S * duration
    if abs(turned) >= 2.0 * math.pi:
        return "circled" if moved else "spun"
    return "drove" if moved else "stood"
