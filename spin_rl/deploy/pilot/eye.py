"""The depth camera as a pinhole: from pixels to points, and back. Images are upright."""

from __future__ import annotations

import numpy as np

from spin_rl.deploy.contract import Camera
from spin_rl.deploy.kinematics import Frame

NEAR_M, FAR_M = 0.2, 4.0
"""Depths that are believed: beyond, a stereo camera's error is as large as a cell of the map."""
_SLACK_M, _SLACK_PER_M = 0.05, 0.05
"""What lies so far behind a point, and this share of its depth, lies behind it for sure."""


class Eye:
    """Geometry of the policy's image in the optical frame: x down, y to the left, z ahead."""

    def __init__(self, camera: Camera) -> None:
        """Take the intrinsics; the camera must have an image."""
        assert camera.image is not None and camera.focal_px is not None
        self._shape, self._focal = camera.image, camera.focal_px
        rows, columns = self._shape
        x = (np.arange(rows) - (rows - 1) / 2) / self._focal[0]
        y = ((columns - 1) / 2 - np.arange(columns)) / self._focal[1]
        self._rays = np.stack([*np.meshgrid(x, y, indexing="ij"), np.ones(self._shape)], -1)

    def points(self, depth: np.ndarray) -> np.ndarray:
        """Return the points that an image [m] shows, shape (n, 3); 0 is where nothing was measured."""
        seen = (depth > NEAR_M) & (depth < FAR_M)
        return depth[seen, None] * self._rays[seen]

    def rims(self, depth: np.ndarray) -> np.ndarray:
        """Return points half a pixel beside the edges of what an image [m] shows, shape (n, 3).

        A thing ends somewhere between the last pixel that shows it and the next one in its row.
        """
        seen = (depth > NEAR_M) & (depth < FAR_M)
        inverse = np.where(depth > NEAR_M, 1.0 / np.maximum(depth, NEAR_M), 0.0)
        points = []
        for side in (1, -1):
            here, before, beside = (np.roll(inverse, shift, axis=1) for shift in (0, side, -side))
            # A plane goes on so: inverse depths are linear in the pixels.
            goes_on = 2.0 * here - before
            ends = seen & (goes_on > 0.0) & (beside * (1.0 + _SLACK_PER_M + _SLACK_M * goes_on) < goes_on)
            ends[:, [0, -1]] = False
            rays = self._rays[ends]
            rays[:, 1] -= side * 0.5 / self._focal[1]
            points.append(depth[ends, None] * rays)
        return np.concatenate(points)

    def sees_through(self, points: np.ndarray, depth: np.ndarray, camera: Frame) -> np.ndarray:
        """Return which points an image shows to be in free air: all pixels around them see what is behind.

        Args:
            points: Points [m], shape (n, 3).
            depth: Image [m], 0 where nothing was measured.
            camera: Where the camera is, in the frame of the points.

        Returns:
            Booleans, shape (n,).
        """
        rows, columns = self._shape
        x, y, z = ((points - camera.pos) @ camera.mat).T
        ahead = np.maximum(z, NEAR_M)
        row = np.rint((rows - 1) / 2 + self._focal[0] * x / ahead).astype(int)
        column = np.rint((columns - 1) / 2 - self._focal[1] * y / ahead).astype(int)
        inside = (z > NEAR_M) & (row > 0) & (row < rows - 1) & (column > 0) & (column < columns - 1)
        row, column = np.clip(row, 1, rows - 2) - 1, np.clip(column, 1, columns - 2) - 1
        return inside & (_nearest_around(depth)[row, column] > z * (1.0 + _SLACK_PER_M) + _SLACK_M)


def _nearest_around(depth: np.ndarray) -> np.ndarray:
    """Return the least depth of every pixel's 3 x 3 neighbourhood, shape (rows - 2, columns - 2)."""
    across = np.minimum(np.minimum(depth[:, :-2], depth[:, 1:-1]), depth[:, 2:])
    return np.minimum(np.minimum(across[:-2], across[1:-1]), across[2:])
