"""Settings of the depth filter, shared by simulation and robot."""

from __future__ import annotations

import math
from dataclasses import dataclass

MAX_HOLD_STEPS = 255
MAX_REACH_PX = 8
"""Largest half side of a window that fills holes [pixel]."""


@dataclass(frozen=True)
class DepthFilterConfig:
    """Steps of the filter, in their order; each is off at zero, and all are by default.

    Source: SPIN paper, "Post-processing for clean depth images"; docs/depth_camera.md tells what differs from
    Ku et al. 2018.

    Attributes:
        dilate_px: Radius of the diamond in which a hole takes the nearest depth [pixel].
        close_px: Longest run of holes along the stereo baseline that is closed, with the farther of the
            depths at its two ends [pixel].
        fill_px: Half side of the square in which a hole that is left takes the nearest depth [pixel].
        surface_jump: Neighbours whose depths differ by more than this ratio are different surfaces.
        median_support: A pixel with fewer of its 8 neighbours on its own surface takes the median of its 3x3
            neighbourhood; 9 is a plain median.
        blur: Weight of a neighbour on the same surface, a pixel's own being 1 (a corner's is the square).
        memory: Weight of the last frame's result in a pixel that changed little.
        memory_change: A pixel that changed by more than this ratio starts anew.
        hold_steps: Frames for which a hole keeps the last depth.
        near_m: Depth that the policy sees as 0 [m].
        far_m: Depth that the policy sees as 1, as it does holes [m].
    """

    dilate_px: int = 0
    close_px: int = 0
    fill_px: int = 0
    surface_jump: float = 0.1
    median_support: int = 0
    blur: float = 0.0
    memory: float = 0.0
    memory_change: float = 0.05
    hold_steps: int = 0
    near_m: float = 0.2
    far_m: float = 4.0

    def __post_init__(self) -> None:
        """Reject impossible values with the key's name."""
        limits = {"close_px": 50, "median_support": 9, "hold_steps": MAX_HOLD_STEPS}
        limits |= dict.fromkeys(("dilate_px", "fill_px"), MAX_REACH_PX)
        for name, high in limits.items():
            value = getattr(self, name)
            if not 0 <= value <= high:
                raise ValueError(f"depth.filter.{name} must be in [0, {high}], got {value}")
        for name in ("surface_jump", "memory_change"):
            value = getattr(self, name)
            if not 0.0 < value < 1.0:
                raise ValueError(f"depth.filter.{name} must be in (0, 1), got {value}")
        if not 0.0 <= self.blur <= 1.0:
            raise ValueError(f"depth.filter.blur must be in [0, 1], got {self.blur}")
        if not 0.0 <= self.memory < 1.0:
            raise ValueError(f"depth.filter.memory must be in [0, 1), got {self.memory}")
        if not 0.0 <= self.near_m < self.far_m < math.inf:
            raise ValueError(
                f"depth.filter.near_m must be in [0, far_m), got {self.near_m} with far_m {self.far_m}"
            )
