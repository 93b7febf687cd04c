"""The robot's own shape: the boxes that must not hit anything, and what it sees of itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from spin_rl.deploy.kinematics import Frame, rotation
from spin_rl.deploy.pilot.settings import NUM_HULLS, Shape


@dataclass(frozen=True)
class Hulls:
    """Upright boxes around parts of the robot, in the base frame [m].

    Attributes:
        low: Their lowest corners, shape (4, 3).
        high: Their highest.
    """

    low: np.ndarray
    high: np.ndarray


class Body:
    """The robot's collision geoms."""

    def __init__(self, shapes: Sequence[Shape]) -> None:
        """Take them in any order; every hull must have one."""
        shapes = sorted(shapes, key=lambda shape: shape.hull)
        self._bodies = [shape.body for shape in shapes]
        self._pos = np.array([shape.pos for shape in shapes])
        self._axes = np.stack([rotation(np.array(shape.quat)) for shape in shapes])
        self._half = np.array([shape.half_size for shape in shapes])
        self._radius = np.array([shape.radius for shape in shapes])
        self._first = np.searchsorted([shape.hull for shape in shapes], np.arange(NUM_HULLS))

    def pose(self, bodies: Mapping[str, Frame]) -> Posed:
        """Put the geoms where the robot's bodies are, see `Kinematics.bodies`."""
        mats = np.stack([bodies[name].mat for name in self._bodies])
        centre = np.stack([bodies[name].pos for name in self._bodies])
        centre = centre + (mats @ self._pos[..., None])[..., 0]
        axes = mats @ self._axes
        reach = (np.abs(axes) @ self._half[..., None])[..., 0] + self._radius[:, None]
        low = np.minimum.reduceat(centre - reach, self._first)
        high = np.maximum.reduceat(centre + reach, self._first)
        return Posed(Hulls(low, high), centre, axes, self._half, self._radius)


@dataclass(frozen=True)
class Posed:
    """The robot's shape at some joints, in the base frame.

    Attributes:
        hulls: The boxes around its parts.
        centre: Middles of its geoms [m], shape (n, 3).
        axes: Their axes as columns, shape (n, 3, 3).
        half: Their half extents [m], shape (n, 3).
        radius: Of their roundings [m], shape (n,).
    """

    hulls: Hulls
    centre: np.ndarray
    axes: np.ndarray
    half: np.ndarray
    radius: np.ndarray

    def holds(self, points: np.ndarray, slack: float) -> np.ndarray:
        """Return which points (n, 3) in the base frame are nearer to the robot than a distance [m]; (n,)."""
        boxes = zip(self.hulls.low - slack, self.hulls.high + slack, strict=True)
        near = np.zeros(len(points), dtype=bool)
        for low, high in boxes:
            near |= ((points > low) & (points < high)).all(-1)
        offset = points[near, None] - self.centre
        local = np.abs(np.einsum("pni,nij->pnj", offset, self.axes))
        outside = np.linalg.norm(np.maximum(local - self.half, 0.0), axis=-1)
        near[near] = (outside < self.radius + slack).any(-1)
        return near
