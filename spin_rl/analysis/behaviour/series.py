"""What camera, arm and base did over the time of an episode, beside the distance to one obstacle."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from spin_rl.analysis.behaviour.events import Event
from spin_rl.analysis.behaviour.trace import DriveTrace

LABELS: Mapping[str, str] = MappingProxyType(
    {
        "distance_m": "base to obstacle [m]",
        "speed_m_s": "base speed [m/s]",
        "heading_rad": "heading [rad]",
        "pan_rad": "head pan [rad]",
        "tilt_rad": "head tilt [rad]",
        "hand_m": "height of the hand [m]",
    }
)
"""Name of a series -> what an axis calls it."""
_DIGITS = 4


def series_of(trace: DriveTrace, event: Event) -> dict[str, Any]:
    """Follow the episode of an event.

    Returns:
        `time_s` and the series of `LABELS`, of every observation; `heading_rad` is relative to that of the
        event. `obstacle_m` is bottom and top of the obstacle, `floats` whether it does.
    """
    heading = np.unwrap(trace.qpos[:, 2])
    now = min(round(event.time_s / trace.period), trace.steps - 1)
    values = {
        "time_s": trace.period * np.arange(trace.steps),
        "distance_m": trace.distance(event.slot, trace.qpos[:, :2]),
        "speed_m_s": trace.speed,
        "heading_rad": heading - heading[now],
        "pan_rad": trace.joint("head_pan"),
        "tilt_rad": trace.joint("head_tilt"),
        "hand_m": trace.hand[:, 2],
    }
    bottom, top = trace.height_of(event.slot)
    series = {name: np.round(value, _DIGITS).tolist() for name, value in values.items()}
    return series | {"obstacle_m": [round(bottom, _DIGITS), round(top, _DIGITS)], "floats": bottom > 0.0}
