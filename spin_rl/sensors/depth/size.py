"""Rows and columns of depth images."""

from __future__ import annotations

from spin_rl import robot

PIXELS = (87, 58)
"""Default pixels along the longer and the shorter side (paper, "Implementation Details")."""


def image_shape(camera_mount: robot.CameraMount) -> tuple[int, int]:
    """Rows and columns of the images of an upright camera, as `DepthCamera` has them."""
    tan_x, tan_y = robot.camera_tan_half_fov(camera_mount)
    return PIXELS if tan_x >= tan_y else (PIXELS[1], PIXELS[0])
