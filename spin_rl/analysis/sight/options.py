"""What the sight analysis looks for, from where."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from spin_rl.config import Range

MAP = "map"
"""Name of the driver that needs no policy, see `driver.MapDriver`."""

Angle = Annotated[float, Range()]


@dataclass(frozen=True)
class SightOptions:
    """Head poses and criterion.

    Attributes:
        pans: Of the constant poses [rad].
        tilts: Of the constant poses [rad].
        lead_s: How long before a touch its obstacle counts [s].
        near_m: Distance that counts as touching [m].
        moved_m: An obstacle is known where it was seen until it has moved by more than this [m].
        fresh_s: One that moves is known for so long after it was seen [s].
        speed_m_s: How fast `MAP` drives, where the robot can [m/s].
    """

    pans: tuple[Angle, ...]
    tilts: tuple[Angle, ...]
    lead_s: Annotated[float, Range(0.1, 10.0)] = 0.8
    near_m: Annotated[float, Range(0.0, 1.0)] = 0.03
    moved_m: Annotated[float, Range(0.0, 10.0)] = 0.05
    fresh_s: Annotated[float, Range(0.0, 100.0)] = 0.5
    speed_m_s: Annotated[float, Range(0.0, 2.0, above=True)] = 0.5
