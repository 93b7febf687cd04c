"""Base speeds that keep the base away from everything; see `spin_rl.tasks.fetch.scripts.bumper`."""

from __future__ import annotations

import math

import numpy as np

from spin_rl import robot
from spin_rl.deploy.fetch.known import Slots
from spin_rl.deploy.fetch.numbers import BUMPER_M, BUMPER_S

_POINTS_A_SIDE = 4


def without_bumps(base: np.ndarray, near: Slots, forward: float, turn: float) -> tuple[float, float]:
    """Return base speeds, those set to 0 that would take the base too near to anything.

    Args:
        base: x, y [m], yaw [rad], shape (3,).
        near: What stands around.
        forward: [m/s].
        turn: [rad/s].
    """
    way = BUMPER_S * forward * np.array([math.cos(base[2]), math.sin(base[2])])
    if _touches(base[:2] + way, base[2], near):
        forward = 0.0
    if _touches(base[:2], base[2] + BUMPER_S * turn, near):
        turn = 0.0
    return forward, turn


def _outline() -> np.ndarray:
    """Points on the outline of the base box in its frame, shape (16, 2)."""
    (rear, front), side = robot.BASE_X_M, robot.BASE_HALF_WIDTH_M
    corners = np.array([[rear, -side], [front, -side], [front, side], [rear, side]])
    share = np.arange(_POINTS_A_SIDE)[:, None] / _POINTS_A_SIDE
    ends = np.roll(corners, -1, axis=0)
    return np.concatenate([a + share * (b - a) for a, b in zip(corners, ends, strict=True)])


_OUTLINE = _outline()


def _touches(at: np.ndarray, yaw: float, near: Slots) -> bool:
    """Whether the base at a pose comes nearer to anything than the bumper's distance."""
    is_high = near.pos[:, 2] - near.half[:, 2] <= robot.BASE_TOP_M + BUMPER_M
    is_low = near.pos[:, 2] + near.half[:, 2] >= -BUMPER_M
    cos, sin = math.cos(yaw), math.sin(yaw)
    points = at + _OUTLINE @ np.array([[cos, sin], [-sin, cos]])
    offset = points[None] - near.pos[:, None, :2]
    cos, sin = np.cos(near.yaw)[:, None], np.sin(near.yaw)[:, None]
    along = np.abs(cos * offset[..., 0] + sin * offset[..., 1]) - near.half[:, None, 0]
    across = np.abs(cos * offset[..., 1] - sin * offset[..., 0]) - near.half[:, None, 1]
    box = np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0)) < BUMPER_M
    cylinder = np.hypot(offset[..., 0], offset[..., 1]) < BUMPER_M + near.half[:, None, 0]
    touched = np.where(near.is_cylinder[:, None], cylinder, box)
    return bool((touched & (is_high & is_low)[:, None]).any())
