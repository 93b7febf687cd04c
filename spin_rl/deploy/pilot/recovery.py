"""The way out for a robot that is stuck: two commands in turn that bring it nearest the goal.

As `warp_kernels.guard.recovery`: a base that stays in its place is driven by the planner for some seconds.
"""

from __future__ import annotations

import numpy as np

from spin_rl.deploy.pilot.field import Field
from spin_rl.deploy.pilot.guard import BACK_M_S
from spin_rl.deploy.pilot.trial import Motion, Trial

_MOVED_M = 0.15
"""A base that got so far from where it was is not stuck [m]."""
_RECOVERY_S = 4.0
_FIRST_S, _BACK_S, _SECOND_S = 0.8, 2.4, 1.0
"""How long a recovery takes, and its two commands; backwards, which is slow, the first may take longer."""
_SLOW_M_S = 0.3
"""Speed that is tried ahead [m/s]."""
_TURNS = np.array([-1.0, -0.5, -0.2, 0.0, 0.2, 0.5, 1.0])
"""Turning speeds that are tried, shares of the limit."""
_AT_ONCE = 32
"""Pairs that are tried together."""
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
        self._place, self._stuck, self._left = place, 0, 0
        self._plan: list[tuple[np.ndarray, int]] = []

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
            self._stuck, self._left, self._plan = 0, self._steps, []
        if self._left == 0:
            return None
        self._left -= 1
        trial = trial.without_margin()  # the robot may have got to where a margin leaves no way
        if not self._plan or not trial.is_free(self._plan[0][0][None], 2)[0]:
            self._plan = self._way_out(base, trial, field)
        (command, steps), *then = self._plan
        self._plan = [(command, steps - 1), *then] if steps > 1 else then
        return command if trial.is_free(command[None], 1)[0] else np.zeros(2)

    def _way_out(self, base: np.ndarray, trial: Trial, field: Field) -> list[tuple[np.ndarray, int]]:
        """Return two commands with how many steps they take; a stop where nothing leads out."""
        ahead, back, turn = trial.drive.most
        slow, back, turns = min(ahead, _SLOW_M_S), -min(back, BACK_M_S), turn * _TURNS
        first, steps, middle = self._first_driven(slow, back, turns, trial)
        seconds = _pairs((slow, 0.0), turns)
        which = np.repeat(np.arange(len(first)), len(seconds))
        second = np.tile(seconds, (len(first), 1))
        poses, end = trial.drive.follow(Motion(middle.pose[which], middle.speed[which]), second, self._second)
        moves = (np.hypot(*end.pose[:, :2].T) > _STAY_M) | (np.abs(end.pose[:, 2]) > _STAY_RAD)
        cost = np.where(moves, _left_to_go(end.pose, base, field), np.inf)
        order = np.argsort(cost, kind="stable")[: np.count_nonzero(moves)]
        for at in range(0, len(order), _AT_ONCE):
            some = order[at : at + _AT_ONCE]
            free = some[~trial.hits(poses[some])]
            if free.size:
                best = which[free[0]]
                return [(first[best], int(steps[best])), (second[free[0]], self._second)]
        return [(np.zeros(2), self._first)]

    def _first_driven(
        self, slow: float, back: float, turns: np.ndarray, trial: Trial
    ) -> tuple[np.ndarray, np.ndarray, Motion]:
        """Drive first commands; return those that hit nothing, how many steps they took, and where to."""
        found = []
        for speeds, steps in (((slow, 0.0, back), self._first), ((back,), self._back)):
            commands = _pairs(speeds, turns)
            poses, end = trial.drive.follow(trial.start(len(commands)), commands, steps)
            free = ~trial.hits(poses)
            found.append((commands[free], np.full(free.sum(), steps), end.pose[free], end.speed[free]))
        commands, steps, pose, speed = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return commands, steps, Motion(pose, speed)


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
