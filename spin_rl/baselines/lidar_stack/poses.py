"""Arithmetic of poses (x [m], y [m], yaw [rad]) of many worlds, on the last axis of arrays."""

from __future__ import annotations

import numpy as np


def compose(frame: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Take poses that are told in frames to where these frames are told in, shape (..., 3)."""
    xy = to_frame_of(frame, pose[..., :2])
    return np.concatenate((xy, frame[..., 2:] + pose[..., 2:]), axis=-1)


def relative(frame: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Tell poses in frames: the inverse of `compose`, shape (..., 3)."""
    xy = into_frame(frame, pose[..., :2])
    return np.concatenate((xy, pose[..., 2:] - frame[..., 2:]), axis=-1)


def to_frame_of(frame: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Take points that are told in frames to where these frames are told in, shape (..., 2)."""
    c, s = np.cos(frame[..., 2]), np.sin(frame[..., 2])
    x, y = point[..., 0], point[..., 1]
    return np.stack((frame[..., 0] + c * x - s * y, frame[..., 1] + s * x + c * y), axis=-1)


def into_frame(frame: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Tell points in frames: the inverse of `to_frame_of`, shape (..., 2)."""
    c, s = np.cos(frame[..., 2]), np.sin(frame[..., 2])
    x, y = point[..., 0] - frame[..., 0], point[..., 1] - frame[..., 1]
    return np.stack((c * x + s * y, c * y - s * x), axis=-1)


def wrap(angle: np.ndarray) -> np.ndarray:
    """Bring angles into [-pi, pi)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi
