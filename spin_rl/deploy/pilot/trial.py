"""Commands tried: the base drives them in thought, among what was seen; as `warp_kernels.guard` does.

What a hull is too near to at the start, since the box says more than the robot is or the thing was seen late,
it may leave but not come nearer to. Nothing is expected to move.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass

import numpy as np

from spin_rl.deploy.contract import Contract
from spin_rl.deploy.pilot.body import Hulls
from spin_rl.deploy.pilot.costmap import Costmap, layers_between
from spin_rl.deploy.pilot.settings import FIRST_ARM_HULL, NUM_HULLS

_REACH_M = 1.6
"""Nothing farther from the base's origin is hit within the time that is looked ahead [m]."""
_BRAKE_STEPS = 4
"""After these a base that brakes stands, nearly."""
_NEARER_M = 1.0e-4
"""A hull that is too near to a thing comes nearer to it when it does by so much; it may at every tick."""
_ARM_NEAR_M = 0.01
"""Distance that counts as a hit of the arm's own motion [m]."""
_DEEPER_M = 0.002
"""What the arm is in already it goes deeper into when it does by so much [m]."""


@dataclass(frozen=True)
class Drive:
    """How the base follows commands.

    Attributes:
        most: Largest speeds ahead and back [m/s] and in turning [rad/s], all positive.
        change: Largest change of the forward [m/s] and turning speed [rad/s] in a step, shape (2,).
        blend: Share of what is left to a command that a step makes up for.
        period: Time of a step [s].
    """

    most: tuple[float, float, float]
    change: np.ndarray
    blend: float
    period: float

    @classmethod
    def of(cls, contract: Contract, speed_scale: float) -> Drive:
        """Take limits from a contract with a guard; see `Decoder` for `speed_scale`."""
        profile, period = contract.speed_profile, contract.period_s
        assert contract.guard is not None
        most = (profile.forward_max, profile.reverse_max, profile.turn_max)
        ahead, back, turn = (speed_scale * speed for speed in most)
        change = period * np.array([profile.base_acceleration, profile.turn_acceleration])
        return cls((ahead, back, turn), change, -math.expm1(-period / contract.guard.lag_s), period)

    def follow(self, motion: Motion, commands: np.ndarray, steps: int) -> tuple[np.ndarray, Motion]:
        """Drive commands [m/s, rad/s], shape (n, 2), for some steps.

        Returns:
            The poses after every step, shape (n, steps, 3), and the motion after the last.
        """
        pose, speed = motion.pose, motion.speed
        poses = np.empty((len(pose), steps, 3))
        for step in range(steps):
            following = speed + np.clip((commands - speed) * self.blend, -self.change, self.change)
            driven, turned = (0.5 * self.period * (speed + following)).T
            yaw = pose[:, 2] + 0.5 * turned
            pose = pose + np.stack([driven * np.cos(yaw), driven * np.sin(yaw), turned], -1)
            speed = following
            poses[:, step] = pose
        return poses, Motion(pose, speed)

    def command_of(self, action: np.ndarray) -> np.ndarray:
        """Return the command [m/s, rad/s] of the base's two actions, shape (2,)."""
        ahead, turn = np.clip(action, -1.0, 1.0)
        return np.array([ahead * self.most[0 if ahead > 0.0 else 1], turn * self.most[2]])

    def action_of(self, command: np.ndarray) -> np.ndarray:
        """Return the base's two actions of a command [m/s, rad/s], shape (2,)."""
        return np.array([command[0] / self.most[0 if command[0] > 0.0 else 1], command[1] / self.most[2]])


@dataclass(frozen=True)
class Motion:
    """Bases on their way.

    Attributes:
        pose: x, y [m] and yaw [rad] in the frame of the base now, shape (n, 3).
        speed: Forward [m/s] and turning [rad/s], shape (n, 2).
    """

    pose: np.ndarray
    speed: np.ndarray


class Trial:
    """Tries commands at one moment."""

    def __init__(
        self, costmap: Costmap, hulls: Hulls, base: np.ndarray, now: np.ndarray, drive: Drive, margin: float
    ) -> None:
        """Look around.

        Args:
            costmap: What was seen.
            hulls: The robot.
            base: Its pose in the frame of the odometry: x, y [m], yaw [rad], shape (3,).
            now: Its forward [m/s] and turning speed [rad/s], shape (2,).
            drive: How it follows commands.
            margin: Distance that counts as a hit [m].
        """
        self.drive, self._yaw = drive, float(base[2])
        self._set_hulls(hulls)
        self._now = now
        cos, sin = math.cos(base[2]), math.sin(base[2])
        self._hulls, self._window = hulls, costmap.around(base[:2], _REACH_M)
        offset = self._window.middle - base[:2]
        self._at = np.stack([offset @ (cos, sin), offset @ (-sin, cos)], -1)
        self._things = [self._gather(hull) for hull in range(NUM_HULLS)]
        self._keep = self._distances(margin)

    def without_margin(self) -> Trial:
        """Return the same among the same things, with nothing around the robot."""
        tight = copy.copy(self)
        tight._keep = self._distances(0.0)
        return tight

    def start(self, count: int) -> Motion:
        """Return so many times the base as it moves now."""
        return Motion(np.zeros((count, 3)), np.tile(self._now, (count, 1)))

    def is_free(self, commands: np.ndarray, steps: int) -> np.ndarray:
        """Return which commands [m/s, rad/s] hit nothing in so many steps and a braking; (n, 2) -> (n,)."""
        driven, motion = self.drive.follow(self.start(len(commands)), commands, steps)
        braked, _ = self.drive.follow(motion, np.zeros_like(commands), _BRAKE_STEPS)
        return ~self.hits(np.concatenate([driven, braked], axis=1))

    def hits(self, poses: np.ndarray) -> np.ndarray:
        """Return which drives hit something: poses in the frame of the base now, (n, steps, 3) -> (n,)."""
        hit = np.zeros(len(poses), dtype=bool)
        for hull, things in enumerate(self._things):
            left = np.flatnonzero(~hit)
            if things.shape[1] and left.size:
                gaps = self._gaps(poses[left].reshape(-1, 3), hull, things)
                hit[left] = (gaps <= self._keep[hull]).reshape(len(left), -1).any(axis=-1)
        return hit

    def arm_goes_in(self, soon: Hulls) -> bool:
        """Return whether the arm touches what it does not now, or goes deeper, with other hulls."""
        then = copy.copy(self)
        then._set_hulls(soon)
        here, layers = np.zeros((1, 3)), self._window.layers
        for hull in range(FIRST_ARM_HULL, NUM_HULLS):
            counts = (layers & _levels(soon, hull)) > 0
            things = _columns(counts, self._at, self._window.half)
            is_level = (layers[counts] & _levels(self._hulls, hull)) > 0
            gap = np.where(is_level, self._gaps(here, hull, things)[0] - _DEEPER_M, _ARM_NEAR_M)
            if (then._gaps(here, hull, things)[0] < np.minimum(gap, _ARM_NEAR_M)).any():
                return True
        return False

    def _set_hulls(self, hulls: Hulls) -> None:
        self._middle = 0.5 * (hulls.low + hulls.high)[:, :2]
        self._half = 0.5 * (hulls.high - hulls.low)[:, :2].astype(np.float32)

    def _distances(self, margin: float) -> list[np.ndarray]:
        """Return for every hull how near its things must not come [m]."""
        here = np.zeros((1, 3))
        gaps = (self._gaps(here, hull, things)[0] for hull, things in enumerate(self._things))
        return [np.minimum(gap - _NEARER_M, margin) for gap in gaps]

    def _gather(self, hull: int) -> np.ndarray:
        """Collect what a hull may hit: x, y [m], 1, and half extents in the odometry's axes, (5, n)."""
        half, counts = self._window.half, (self._window.layers & _levels(self._hulls, hull)) > 0
        # Nothing gets to what has things on all sides without hitting these, if it is not in them already.
        keeps = counts.copy()
        keeps[counts] = self._gaps(np.zeros((1, 3)), hull, _columns(counts, self._at, half))[0] > _NEARER_M
        is_edge = counts.copy()
        is_edge[1:-1, 1:-1] &= ~(keeps[:-2, 1:-1] & keeps[2:, 1:-1] & keeps[1:-1, :-2] & keeps[1:-1, 2:])
        return _columns(is_edge, self._at, half)

    def _gaps(self, poses: np.ndarray, hull: int, things: np.ndarray) -> np.ndarray:
        """Return how far a hull at poses (m, 3) is from things (5, n), along its own axes, (m, n) [m].

        It is negative where they overlap.
        """
        (x, y, yaw), middle, half = poses.T, self._middle[hull], self._half[hull]
        cos, sin = np.cos(yaw), np.sin(yaw)
        along = np.stack([cos, sin, -(cos * x + sin * y) - middle[0]], -1).astype(np.float32)
        aside = np.stack([-sin, cos, sin * x - cos * y - middle[1]], -1).astype(np.float32)
        yaw = yaw + self._yaw
        wide = np.abs(np.stack([np.cos(yaw), np.sin(yaw)], -1)).astype(np.float32)
        ahead = np.abs(along @ things[:3]) - wide @ things[3:] - half[0]
        return np.maximum(ahead, np.abs(aside @ things[:3]) - wide[:, ::-1] @ things[3:] - half[1])


def _levels(hulls: Hulls, hull: int) -> np.uint32:
    return layers_between(hulls.low[hull, 2], hulls.high[hull, 2])


def _columns(which: np.ndarray, middle: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Return the chosen cells' middles, a 1, and half extents as columns, shape (5, n), float32."""
    ones = np.ones((np.count_nonzero(which), 1))
    return np.ascontiguousarray(np.concatenate([middle[which], ones, half[which]], -1).T, dtype=np.float32)
