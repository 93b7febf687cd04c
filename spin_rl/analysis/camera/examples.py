"""Single episodes over time: where the camera points while the base drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spin_rl.tasks.common import episode

EXAMPLES = 3
_MOVES_M_S = 0.05
"""Things that are slower stand still [m/s]."""


@dataclass(frozen=True)
class Recording:
    """Episodes of a batch at their observations; an episode's are those before `ends`.

    Attributes:
        poses: Pan and tilt [rad], shape (steps, episodes, 2).
        base: Base pose x, y, yaw [m, rad], shape (steps, episodes, 3).
        fastest: Largest speed of a thing over the floor since the observation before [m/s], shape (steps,
            episodes).
        ends: Number of observations of each episode, 0 where it did not end, shape (episodes,).
        outcomes: `episode` codes of those that ended, shape (episodes,).
        period: Time between two observations [s].
    """

    poses: np.ndarray
    base: np.ndarray
    fastest: np.ndarray
    ends: np.ndarray
    outcomes: np.ndarray
    period: float


def examples(recording: Recording, most: int = EXAMPLES) -> list[dict[str, Any]]:
    """Follow the first episodes that succeed, or that end where too few do.

    Returns:
        Of each `world` and `outcome`, and by observation `time_s`, `pan_rad`, `tilt_rad` and `speed_m_s`,
        that of the base along its heading up to the next observation; `comes_out_s`, the times at which
        something began to move while nothing had.
    """
    ended = np.flatnonzero(recording.ends > 1).tolist()
    ended.sort(key=lambda world: recording.outcomes[world] != episode.SUCCESS)
    return [_example(recording, world) for world in ended[:most]]


def _example(recording: Recording, world: int) -> dict[str, Any]:
    end = int(recording.ends[world])
    poses, base = recording.poses[:end, world], recording.base[:end, world]
    moves = recording.fastest[:end, world] > _MOVES_M_S
    begins = moves & ~np.insert(moves[:-1], 0, False)
    return {
        "world": world,
        "outcome": episode.OUTCOMES[int(recording.outcomes[world])],
        "time_s": _rounded(recording.period * np.arange(end)),
        "pan_rad": _rounded(poses[:, 0]),
        "tilt_rad": _rounded(poses[:, 1]),
        "speed_m_s": _rounded(_along(base) / recording.period),
        "comes_out_s": _rounded(recording.period * np.flatnonzero(begins)),
    }


def _along(base: np.ndarray) -> np.ndarray:
    """Steps of the base along its heading up to the next observation [m], shape (n,), the last one twice."""
    steps = np.diff(base[:, :2].astype(np.float64), axis=0)
    yaw = base[:-1, 2]
    along = steps[:, 0] * np.cos(yaw) + steps[:, 1] * np.sin(yaw)
    return np.append(along, along[-1:])


def _rounded(values: np.ndarray | Sequence[float]) -> list[float]:
    return np.round(np.asarray(values, dtype=np.float64), 3).tolist()
