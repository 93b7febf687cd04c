"""Where the robot was shortly before: an image is older than the state that is read with it."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from spin_rl.deploy.interface import RobotState

_KEPT = 16
"""States: those of 1.5 s, older than any image that is used."""


class Track:
    """The last states of one episode."""

    def __init__(self) -> None:
        """Begin without any."""
        self._states: deque[RobotState] = deque(maxlen=_KEPT)

    def add(self, state: RobotState) -> None:
        """Note the latest state; one with a stamp that is no later takes the place of those before it."""
        while self._states and self._states[-1].stamp_s >= state.stamp_s:
            self._states.pop()
        self._states.append(state)

    def at(self, time_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Return joints [m, rad], shape (8,), and pose of the base, shape (3,), at a time [s].

        They are interpolated; before the first state they are that one's, after the last that one's.
        """
        after = self._states[-1]
        for before in reversed(self._states):
            if before.stamp_s <= time_s:
                break
            after = before
        else:
            return after.joints, after.base
        if before is after:
            return after.joints, after.base
        share = (time_s - before.stamp_s) / (after.stamp_s - before.stamp_s)
        moved = after.base - before.base
        moved[2] = math.remainder(moved[2], math.tau)
        return before.joints + share * (after.joints - before.joints), before.base + share * moved
