"""Projection of world points into a picture, and a camera that follows the robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_NEAR_M = 0.05


@dataclass(frozen=True)
class PinholeCamera:
    """A MuJoCo camera: x right, y up, looking along -z.

    Attributes:
        pos: Centre [m], world, shape (3,).
        mat: Rotation of the camera frame to the world, shape (3, 3).
        fovy: Vertical field of view [degrees].
        width: Columns of the picture.
        height: Rows of the picture.
    """

    pos: np.ndarray
    mat: np.ndarray
    fovy: float
    width: int
    height: int

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Project world points.

        Args:
            points: World positions [m], shape (n, 3).

        Returns:
            Pixels (column from the left, row from the top; centres of pixels at half integers), shape (n, 2),
            and depths along the line of sight [m], shape (n,). Pixels of points that are not in front of the
            camera are NaN.
        """
        x, y, z = ((points - self.pos) @ self.mat).T
        depth = -z
        focal = 0.5 * self.height / np.tan(0.5 * np.radians(self.fovy))
        safe = np.where(depth > 0.0, depth, np.nan)
        pixels = np.stack((0.5 * self.width + focal * x / safe, 0.5 * self.height - focal * y / safe), -1)
        return pixels, depth

    def project_segment(self, start: np.ndarray, end: np.ndarray) -> np.ndarray | None:
        """Project the part of a segment that is in front of the camera.

        Returns:
            Pixels of both ends, shape (2, 2), or None if all of it lies behind.
        """
        ends = np.stack((start, end)).astype(float)
        depth = -((ends - self.pos) @ self.mat)[:, 2]
        if (depth < _NEAR_M).all():
            return None
        for i in (0, 1):
            if depth[i] < _NEAR_M:
                share = (_NEAR_M - depth[i]) / (depth[1 - i] - depth[i])
                ends[i] += share * (ends[1 - i] - ends[i])
        return self.project(ends)[0]


Point = tuple[float, float, float]

View = tuple[Point, Point]

DRIVE_VIEW: View = ((-2.1, 0.0, 2.3), (0.35, 0.0, 0.45))
TABLE_VIEW: View = ((-1.7, 0.3, 1.95), (0.0, -0.22, 0.65))
GRASP_VIEW: View = ((-1.15, -0.3, 1.7), (0.05, -0.6, 0.75))
"""Where the camera is and what it looks at, from the base: x ahead, y left, height over the floor [m].

From behind and above while the robot drives; with the table to the right, of robot and table, or close to the
gripper."""


class FollowCamera:
    """Goes with the robot, turning smoothly, and from one view to another likewise."""

    def __init__(self, time_constant: float = 0.8) -> None:
        """Start without a direction.

        Args:
            time_constant: Of the low-pass filter of direction and view [s].
        """
        self._time_constant = time_constant
        self._heading: np.ndarray | None = None
        self._view = np.zeros((2, 3))

    def place(self, base: np.ndarray, view: View, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """Follow one step.

        Args:
            base: Where the base is (x [m], y [m]), and which way is ahead in the view [rad], shape (3,).
            view: `DRIVE_VIEW`, `TABLE_VIEW` or `GRASP_VIEW`.
            dt: Time since the last call [s].

        Returns:
            Position of the camera and the point that it looks at [m], world.
        """
        heading, wanted = np.array([np.cos(base[2]), np.sin(base[2])]), np.array(view)
        if self._heading is not None:
            share = 1 - np.exp(-dt / self._time_constant)
            wanted = self._view + (wanted - self._view) * share
            heading = self._heading + (heading - self._heading) * share
            norm = np.linalg.norm(heading)
            heading = heading / norm if norm > 1e-6 else self._heading
        self._heading, self._view = heading, wanted
        left = np.array([-heading[1], heading[0]])
        pos, look_at = (np.array([*(base[:2] + x * heading + y * left), z]) for x, y, z in wanted)
        return pos, look_at
