"""The way out for a robot that is stuck: two commands in turn that bring it nearest the goal.

As `warp_kernels.guard.recovery`: a base that stays in its place is driven by the planner for some seconds.
"""

from __future__ import annotations

import numpy as np

from spin_rl.deploy.pilot.field import Field
from spin_rl.deploy.pilot.guard import BACK_M_S
from spin_rl.deploy.pilot.trial import Trial

_MOVED_M = 0.15
"""A base that got so far from where it was is not stuck [m]."""
_RECOVERY_S, _FIRST_S, _BACK_S, _SECOND_S = 4.0, 0.8, 2.4, 1.0
"""How long a recovery takes, and its two commands; the first may lead backwards, which is slow, for longer."""
_SLOW_M_S = 0.3
"""Speed that is tried ahead [m/s]."""
_TURNS = np.array([-1.0, -0.5, -0.2, 0.0, 0.2, 0.5, 1.0])
"""Turning speeds that are tried, shares of the limit."""
_STAY_M, _STAY_RAD = 0.05, 0.2
"""Commands that move the base less than this, and turn it less, lead out of nothing."""
_HEADING_M = 0.3
"""Way that turning by 1 rad is worth [m]."""


class Recovery:
    """Notes whether the robot is stuck, and drives it out."""

    def __init__(self, stuck_s: float, period_s: float, place: np.ndarray) -> None:
        """Begin an episode.

        Args:
            stuck_s: Time in one place after which a robot is stuck that is kept from its commands; another is
                after twice the time [s].
            period_s: Time of a step [s].
            place: Where the base is [m], shape (2,).
        """
        self._patience = round(stuck_s / period_s)
        self._steps, self._first, self._back, self._second = (
            round(time / period_s) for time in (_RECOVERY_S, _FIRST_S, _BACK_S, _SECOND_S)
        )
        self._place, self._stuck, self._left, self._hold = place, 0, 0, 0
        self._command = np.zeros(2)
        self._then: np.ndarray | None = None

    def update(self, base: np.ndarray, is_guarded: bool, trial: Trial, field: Field) -> np.ndarray | None:
        """Return the command [m/s, rad/s], shape (2,), while the robot is driven out; else None.

        Args:
            base: Pose in the frame of the odometry, shape (3,).
            is_guarded: Whether the guard kept the robot from its command in this step.
            trial: Tries commands.
            field: Ways to the goal.
        """
        if np.hypot(*(base[:2] - self._place)) > _MOVED_M:
            self._place, self._stuck = base[:2].copy(), 0
        else:
            self._stuck += 2 if is_guarded else 1
        if self._stuck >= 2 * self._patience and self._left == 0:
            self._stuck, self._left, self._hold, self._then = 0, self._steps, 0, None
        if self._left == 0:
            return None
        self._left -= 1
        if self._hold == 0 and self._then is not None:
            self._command, self._hold, self._then = self._then, self._second, None
        if self._hold == 0 or not trial.is_free(self._command[None], 2)[0]:
            self._plan(base, trial, field)
        self._hold -= 1
        return self._command if trial.is_free(self._command[None], 1)[0] else np.zeros(2)

    def _plan(self, base: np.ndarray, trial: Trial, field: Field) -> None:
        """Choose two commands that hit nothing and end nearest to the goal; none if there are none."""
        self._command, self._hold, self._then = np.zeros(2), self._first, None
        ahead, back, turn = trial.drive.most
        slow, turns = min(ahead, _SLOW_M_S), turn * _TURNS
        backwards = -min(back, BACK_M_S)
        seconds = _pairs((slow, 0.0), turns)
        least = np.inf
        for speeds, steps in (((slow, 0.0, backwards), self._first), ((backwards,), self._back)):
            firsts = _pairs(speeds, turns)
            poses, middle = trial.drive.follow(trial.start(len(firsts)), firsts, steps)
            which = np.repeat(np.flatnonzero(~trial.hits(poses)), len(seconds))
            thens = np.tile(seconds, (len(which) // len(seconds), 1))
            poses, end = trial.drive.follow(middle.each(which), thens, self._second)
            moves = (np.hypot(*end.pose[:, :2].T) > _STAY_M) | (np.abs(end.pose[:, 2]) > _STAY_RAD)
            left = np.flatnonzero(moves & ~trial.hits(poses))
            if not left.size:
                continue
            costs = _left_to_go(end.pose[left], base, field)
            if costs.min() < least:
                least, best = costs.min(), left[costs.argmin()]
                self._command, self._hold, self._then = firsts[which[best]], steps, thens[best]


def _pairs(speeds: tuple[float, ...], turns: np.ndarray) -> np.ndarray:
    return np.stack(np.meshgrid(speeds, turns, indexing="ij"), -1).reshape(-1, 2)


def _left_to_go(poses: np.ndarray, base: np.ndarray, field: Field) -> np.ndarray:
    """Return the ways from poses (n, 3) in the base frame, with what turning along them costs, (n,) [m]."""
    cos, sin = np.cos(base[2]), np.sin(base[2])
    x, y, yaw = poses.T
    at = base[:2] + np.stack([cos * x - sin * y, sin * x + cos * y], -1)
    along = field.downhill(at)
    turn = np.arctan2(along[:, 1], along[:, 0]) - base[2] - yaw
    return field.at(at) + _HEADING_M * np.abs(np.arctan2(np.sin(turn), np.cos(turn)))
