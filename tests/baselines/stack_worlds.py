"""A small place and its scans by formula, which the tests of the classical stack share."""

import numpy as np

from spin_rl.baselines.lidar_stack.poses import to_frame_of
from spin_rl.baselines.lidar_stack.scans import LidarModel

ANGLES = np.deg2rad(np.arange(360.0))
MODEL = LidarModel(ANGLES, np.array([0.004, 0.0]), 12.0)

ROOM = (-1.0, -2.0, 5.0, 2.0)
PILLARS = np.array([[1.5, 0.9, 0.2], [3.0, -0.6, 0.3], [0.8, -1.3, 0.15]])
"""Walls (low x, low y, high x, high y) and round pillars (x, y, radius) [m]."""


def exact_ranges(poses, pillars=PILLARS):
    """Ranges from base poses (n, 3) to walls and pillars, shape (n, 360) [m]."""
    laser = to_frame_of(poses, np.broadcast_to(MODEL.position, (len(poses), 2)))
    angle = poses[:, 2:3] + ANGLES
    direction = np.stack((np.cos(angle), np.sin(angle)), axis=-1)
    with np.errstate(divide="ignore"):
        to_low = (np.array(ROOM[:2]) - laser[:, None]) / direction
        to_high = (np.array(ROOM[2:]) - laser[:, None]) / direction
    ranges = np.maximum(to_low, to_high).min(axis=-1)
    for x, y, radius in pillars:
        offset = laser[:, None] - (x, y)
        along = (offset * direction).sum(-1)
        root = along**2 - (offset**2).sum(-1) + radius**2
        hit = -along - np.sqrt(np.maximum(root, 0.0))
        ranges = np.where((root > 0.0) & (hit > 0.0), np.minimum(ranges, hit), ranges)
    return ranges


class Place:
    """Takes noisy scans, as `sensors.lidar.Survey`."""

    def __init__(self, pillars=PILLARS):
        self._pillars, self._rng = pillars, np.random.default_rng(0)

    def scan(self, moved, worlds):
        ranges = exact_ranges(moved, self._pillars)
        return ranges * (1.0 + 0.005 * self._rng.standard_normal(ranges.shape))
