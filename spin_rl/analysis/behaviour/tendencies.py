"""How camera and arm follow what is near: means over bins, and differences with an interval over episodes.

The paper's Figure "cam_behavior": the camera looks down in tight clutter and ahead where nothing is near.
Figure "whole_body_coord": the arm is at another height where something is in its way.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spin_rl.analysis.behaviour.trace import DriveTrace
from spin_rl.analysis.watch import SETTLING_S

NEAR_M, CLEAR_M = 0.6, 1.5
"""Something is near the base; nothing is."""
SIDE_RAD = np.radians(20.0)
"""From here on something is to a side."""
DISTANCE_BINS_M = (0.0, 0.3, 0.6, 1.0, 1.5, 2.0, np.inf)
BEARING_BINS_RAD = tuple(np.radians([-180.0, -90.0, -45.0, -15.0, 15.0, 45.0, 90.0, 180.0]))
_Z95 = 1.96

Samples = tuple[np.ndarray, np.ndarray]
"""Of an episode: what is near, and what camera or arm does, shape (n,) each."""


@dataclass(frozen=True)
class Tendency:
    """What camera or arm does against what is near.

    Attributes:
        name: What is compared.
        unit: Of the values.
        edges: Of the bins of what is near.
        edge_unit: Their unit, "m" or "rad".
        means: Mean of the values in each bin, of all observations; None for an empty one.
        counts: Observations in each bin.
        difference: Mean over episodes of an episode's own difference between the two conditions.
        ci95: Its 95 % interval over episodes; None with fewer than two.
        episodes: Episodes that have both conditions.
    """

    name: str
    unit: str
    edges: tuple[float, ...]
    edge_unit: str
    means: tuple[float | None, ...]
    counts: tuple[int, ...]
    difference: float | None
    ci95: tuple[float, float] | None
    episodes: int


def tendency(
    name: str,
    unit: str,
    samples: Sequence[Samples],
    edges: Sequence[float],
    edge_unit: str,
    one: Callable[[np.ndarray], np.ndarray],
    other: Callable[[np.ndarray], np.ndarray],
) -> Tendency:
    """Sum up the samples of many episodes.

    Args:
        name: What is compared.
        unit: Of the values.
        samples: Of every episode.
        edges: Of the bins.
        edge_unit: Their unit.
        one: Which observations count as the first condition.
        other: Which as the second; the difference is the first's mean less the second's.
    """
    near = np.concatenate([x for x, _ in samples]) if samples else np.zeros(0)
    values = np.concatenate([y for _, y in samples]) if samples else np.zeros(0)
    index = np.digitize(near, edges) - 1
    inside = [values[index == i] for i in range(len(edges) - 1)]
    own = np.array(
        [y[one(x)].mean() - y[other(x)].mean() for x, y in samples if one(x).any() and other(x).any()]
    )
    half = _Z95 * own.std(ddof=1) / np.sqrt(len(own)) if len(own) > 1 else None
    mean = float(own.mean()) if len(own) else None
    return Tendency(
        name,
        unit,
        tuple(float(edge) for edge in edges),
        edge_unit,
        tuple(float(part.mean()) if len(part) else None for part in inside),
        tuple(len(part) for part in inside),
        mean,
        None if mean is None or half is None else (mean - float(half), mean + float(half)),
        len(own),
    )


def tendencies_of(traces: Sequence[DriveTrace]) -> dict[str, Tendency]:
    """Tilt against clutter, pan against its side, and the hand's height against what floats."""
    return {
        "tilt": tendency(
            "camera tilt near an obstacle less far from any",
            "rad",
            [_tilt(trace) for trace in traces],
            DISTANCE_BINS_M,
            "m",
            lambda distance: distance < NEAR_M,
            lambda distance: distance >= CLEAR_M,
        ),
        "pan": tendency(
            "camera pan with the nearest obstacle on the left less on the right",
            "rad",
            [_pan(trace) for trace in traces],
            BEARING_BINS_RAD,
            "rad",
            lambda bearing: (bearing > SIDE_RAD) & (bearing < np.pi / 2),
            lambda bearing: (bearing < -SIDE_RAD) & (bearing > -np.pi / 2),
        ),
        "hand": tendency(
            "hand's height near a floating obstacle less far from any",
            "m",
            [_hand(trace) for trace in traces],
            DISTANCE_BINS_M,
            "m",
            lambda distance: distance < NEAR_M,
            lambda distance: distance >= CLEAR_M,
        ),
    }


def _settled(trace: DriveTrace) -> slice:
    """Episodes start with random poses of camera and arm, which say nothing about the policy."""
    return slice(round(SETTLING_S / trace.period), None)


def _tilt(trace: DriveTrace) -> Samples:
    part = _settled(trace)
    return trace.nearest(trace.obstacles)[0][part], trace.joint("head_tilt")[part]


def _pan(trace: DriveTrace) -> Samples:
    part = _settled(trace)
    distance, slot = trace.nearest(trace.obstacles)
    near = (distance < CLEAR_M)[part]
    return trace.bearing(slot)[part][near], trace.joint("head_pan")[part][near]


def _hand(trace: DriveTrace) -> Samples:
    part = _settled(trace)
    floating = [slot for slot in trace.obstacles if trace.level[slot] == "arm"]
    return trace.nearest(floating)[0][part], trace.hand[part, 2]


def as_dict(found: Tendency) -> dict[str, Any]:
    """A tendency for JSON, which has no infinity: the last edge is null."""
    values = dict(vars(found))
    return values | {"edges": [None if np.isinf(edge) else edge for edge in found.edges]}
