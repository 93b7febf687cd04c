"""From a pixel and its depth to a point in the camera's optical frame and in the robot's base frame.

Images are upright, as `DepthCamera` and `robot_depth.upright` make them: rows run along the optical x axis
and columns against y, in portrait and in landscape alike. The optical frame is that of the site
``camera_depth_optical_frame``: z forward, x down in the world. Pixels are rows and columns, whole numbers at
the pixels' centres. The base frame is on the floor between the wheels: x forward, y left, z up.

Source: SPIN paper, "Object Detection for Pick Policy".
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from spin_rl import robot
from spin_rl.deploy.kinematics import Frame
from spin_rl.detection.interface import Detection

CENTRAL_SHARE = 0.5
"""Part of a box's height and width that its depth is read from: its corners show what is behind."""


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera without distortion, for upright images.

    Attributes:
        shape: Rows and columns.
        focal: Focal lengths along rows and columns [pixels].
        centre: Row and column of the optical axis.
    """

    shape: tuple[int, int]
    focal: tuple[float, float]
    centre: tuple[float, float]

    def __post_init__(self) -> None:
        """Check the numbers."""
        if (
            min(self.shape) < 1
            or not min(self.focal) > 0.0
            or not np.isfinite([*self.focal, *self.centre]).all()
        ):
            raise ValueError(f"shape and focal must be positive and centre finite, got {self}")

    @classmethod
    def from_fov(cls, shape: tuple[int, int], tan_half_fov: tuple[float, float]) -> Intrinsics:
        """Describe an image whose optical axis is in its middle, as `DepthCamera`'s.

        Args:
            shape: Rows and columns.
            tan_half_fov: Tangents of half the field of view along optical x (rows) and y (columns), see
                ``robot.camera_tan_half_fov``.
        """
        rows, columns = shape
        focal = rows / (2.0 * tan_half_fov[0]), columns / (2.0 * tan_half_fov[1])
        return cls(shape, focal, ((rows - 1) / 2.0, (columns - 1) / 2.0))

    @classmethod
    def from_calibration(
        cls,
        width: int,
        height: int,
        focal: tuple[float, float],
        centre: tuple[float, float],
        mount: robot.CameraMount,
    ) -> Intrinsics:
        """Turn the calibration of a camera's own images into that of upright ones.

        Args:
            width: Columns of the camera's own image.
            height: Its rows.
            focal: Focal lengths (fx, fy) along its columns and rows [pixels].
            centre: Optical axis (cx, cy) among its columns and rows, whole numbers at the pixels' centres.
            mount: How the camera is mounted, see `robot_depth.upright`.

        Raises:
            ValueError: The mount is unknown, or a number is not positive.
        """
        (fx, fy), (cx, cy) = focal, centre
        if robot.is_portrait(mount):
            return cls((width, height), (fx, fy), (cx, height - 1 - cy))
        return cls((height, width), (fy, fx), (cy, cx))

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """Return the points at a depth of 1 m that pixels show, in the optical frame.

        Args:
            pixels: Rows and columns, shape (..., 2).

        Returns:
            Points [m], shape (..., 3).
        """
        row, column = np.moveaxis(np.asarray(pixels, dtype=float), -1, 0)
        x = (row - self.centre[0]) / self.focal[0]
        y = (self.centre[1] - column) / self.focal[1]
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def project(self, points: np.ndarray) -> np.ndarray:
        """Return the pixels that show points.

        Args:
            points: Points in the optical frame [m], in front of the camera, shape (..., 3).

        Returns:
            Rows and columns, also beyond the image, shape (..., 2).
        """
        x, y, z = np.moveaxis(np.asarray(points, dtype=float), -1, 0)
        return np.stack(
            [self.centre[0] + self.focal[0] * x / z, self.centre[1] - self.focal[1] * y / z], axis=-1
        )


def robust_depth(
    depth: np.ndarray, box: tuple[float, float, float, float], share: float = CENTRAL_SHARE
) -> float:
    """Return the median depth measured in the central part of a box, 0 if nothing was measured there [m].

    Args:
        depth: z-depth [m], 0 or not finite in holes, shape (rows, columns).
        box: As in `Detection`; what lies outside of the image is left out.
        share: Part of the box's height and of its width that counts, in (0, 1]; one pixel at least.

    Raises:
        ValueError: The image is not two-dimensional, the box is empty or the share is not in (0, 1].
    """
    top, bottom, left, right = box
    if depth.ndim != 2:
        raise ValueError(f"depth must have two dimensions, got shape {depth.shape}")
    if not (top < bottom and left < right):
        raise ValueError(f"box must be top < bottom, left < right, got {box}")
    if not 0.0 < share <= 1.0:
        raise ValueError(f"share must be in (0, 1], got {share}")
    spans = []
    for low, high, size in ((top, bottom, depth.shape[0]), (left, right, depth.shape[1])):
        middle, half = (low + high) / 2.0, share * (high - low) / 2.0
        first = min(round(middle - half), math.floor(middle))
        end = max(round(middle + half), first + 1)
        spans.append(slice(min(max(first, 0), size), min(max(end, 0), size)))
    values = depth[spans[0], spans[1]]
    values = values[np.isfinite(values) & (values > 0.0)]
    return float(np.median(values)) if values.size else 0.0


def deproject(
    pixel: tuple[float, float], depth: float, intrinsics: Intrinsics, *, offset: float = 0.0
) -> np.ndarray:
    """Return the point that a pixel shows, in the optical frame [m], shape (3,).

    Args:
        pixel: Row and column.
        depth: z-depth there [m].
        intrinsics: Of the image.
        offset: How far behind that the point is, along the line of sight: from an object's surface to its
            centre [m].
    """
    ray = intrinsics.rays(np.array(pixel))
    return (depth + offset / float(np.linalg.norm(ray))) * ray


def locate(
    detection: Detection, depth: np.ndarray, intrinsics: Intrinsics, pose: Frame, *, offset: float = 0.0
) -> np.ndarray | None:
    """Return where a detected object is in the base frame [m], shape (3,), or None without a depth.

    Args:
        detection: What a `Detector` found.
        depth: Depth image of the same moment, upright, holes 0 or not finite [m], shape (rows, columns).
        intrinsics: Of that image.
        pose: Where the camera was, of `deploy.kinematics.Kinematics`.
        offset: As in `deproject`.

    Raises:
        ValueError: The depth image is not of the camera's shape.
    """
    if depth.shape != intrinsics.shape:
        raise ValueError(f"depth must be {intrinsics.shape}, as the camera's images are, got {depth.shape}")
    z = robust_depth(depth, detection.box)
    if z == 0.0:
        return None
    return pose.to_base(deproject(detection.pixel, z, intrinsics, offset=offset))
