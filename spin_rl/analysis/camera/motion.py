"""How a camera moves: statistics of its joints, and how often it takes each pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from spin_rl import robot

BIN_RAD = 0.15
"""Width of the bins of pan and of tilt [rad]."""
_CAMERA = [robot.JOINTS.index(joint) for joint in robot.CAMERA_JOINTS]


@dataclass(frozen=True)
class CameraMotion:
    """Statistics of one camera joint over the observations of episodes, after `SETTLING_S`.

    Attributes:
        mean: Over all observations [rad].
        std: Over all observations [rad].
        p5: 5th percentile [rad].
        p95: 95th percentile [rad].
        std_within: Mean of the episodes' own standard deviations [rad]: 0 for a constant pose, even where it
            differs between episodes.
        rate: Mean absolute rate of change [rad/s].
    """

    mean: float
    std: float
    p5: float
    p95: float
    std_within: float
    rate: float


def camera_motion(poses: np.ndarray, valid: np.ndarray, period: float) -> CameraMotion | None:
    """Sum up the recorded positions of a joint.

    Args:
        poses: Positions [rad], shape (steps, episodes).
        valid: Which of them count, shape (steps, episodes), bool.
        period: Time between two steps [s].

    Returns:
        The statistics, or None if nothing counts.
    """
    if not valid.any():
        return None
    values = poses[valid].astype(np.float64)
    pairs = valid[1:] & valid[:-1]
    change = np.abs(np.diff(poses, axis=0))[pairs]
    within = [
        poses[rows, i].astype(np.float64).std() for i, rows in enumerate(valid.T) if np.count_nonzero(rows)
    ]
    return CameraMotion(
        mean=float(values.mean()),
        std=float(values.std()),
        p5=float(np.percentile(values, 5)),
        p95=float(np.percentile(values, 95)),
        std_within=float(np.mean(within)),
        rate=float(change.mean()) / period if change.size else 0.0,
    )


def share_of_time(poses: np.ndarray) -> dict[str, Any]:
    """Count how often each pose was taken.

    Args:
        poses: Pan and tilt [rad], shape (n, 2), n > 0.

    Returns:
        `pan_edges` and `tilt_edges` of the bins [rad], which span the joints' ranges, and `share`, the share
        of the poses in each, shape (pans, tilts).
    """
    edges = [
        robot.JOINT_LOWER[i]
        + BIN_RAD * np.arange(1 + np.ceil((robot.JOINT_UPPER[i] - robot.JOINT_LOWER[i]) / BIN_RAD))
        for i in _CAMERA
    ]
    # A simulated joint may be a hair beyond its range.
    inside = np.clip(poses, [each[0] for each in edges], [each[-1] for each in edges])
    counts = np.histogram2d(inside[:, 0], inside[:, 1], bins=edges)[0]
    return {
        "pan_edges": np.round(edges[0], 4).tolist(),
        "tilt_edges": np.round(edges[1], 4).tolist(),
        "share": np.round(counts / len(poses), 5).tolist(),
    }
