"""The stack as a policy: it reads lidar, odometry and, once, the goal, and drives with the arm stowed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from tensordict import TensorDict

from spin_rl import robot
from spin_rl.baselines.lidar_stack.follower import Follower
from spin_rl.baselines.lidar_stack.grids import Grids, Ways
from spin_rl.baselines.lidar_stack.localization import ParticleFilter
from spin_rl.baselines.lidar_stack.mapping import MappingDrive
from spin_rl.baselines.lidar_stack.poses import to_frame_of
from spin_rl.baselines.lidar_stack.recovery import BACKING, ROTATING, Recovery
from spin_rl.baselines.lidar_stack.scans import LastTurn, LidarModel
from spin_rl.baselines.lidar_stack.settings import PlannerSettings, StackSettings
from spin_rl.tasks.common.formulas import GOAL_SCALE_M

if TYPE_CHECKING:
    from spin_rl.tasks.nav.env import NavEnv


@dataclass
class _State:
    """What is remembered of every world's episode, shape (n, ...)."""

    fresh: np.ndarray  # the place has not been mapped yet
    step: np.ndarray
    goal: np.ndarray  # in the map [m]
    command: np.ndarray  # forward [m/s] and turning [rad/s] speed
    error: np.ndarray  # of their execution, a share
    news: np.ndarray  # what was seen that is not in the map, at the last plan


class LidarStack:
    """A classical stack for all worlds, on the host.

    Places are mapped many at a time: where an episode has ended, the robot stands still until half of all
    worlds wait for that.

    Attributes:
        maps: The maps, for drawings and tests.
        poses: Where the robots take themselves to be in their maps, shape (n, 3).
        map_error: How far the last pose of each mapping drive was off [m], shape (n,).
    """

    def __init__(self, device: str, settings: StackSettings | None = None) -> None:
        """Remember the settings; `enter` makes the rest.

        Args:
            device: Of the actions.
            settings: None takes the defaults.
        """
        self._device = device
        self.settings = settings or StackSettings()

    def enter(self, env: NavEnv) -> None:
        """Take over what a robot knows of itself, and what takes scans in the mapping drive."""
        cfg, n = self.settings, env.num_envs
        assert env.lidar is not None  # the baseline's configuration has seen to it
        self._rng = np.random.default_rng(cfg.seed)
        self._lidar = env.lidar
        self._profile = robot.SPEED_PROFILES[env.cfg.robot_profile]
        self._period = env.cfg.sim.control_period
        model = LidarModel(env.lidar.angles, env.lidar.position[:2], env.lidar.config.far_m)
        self._model = model
        self.maps = Grids(n, cfg.map)
        self.ways = Ways(self.maps, cfg.planner)
        self._mapping = MappingDrive(self.maps, self.ways, model, cfg.map, env.cfg.odometry)
        self._turn = LastTurn(model, n)
        self._filter = ParticleFilter(self.maps, cfg.localization, self._rng)
        self._follower = Follower(cfg.follower, self._profile)
        self.recovery = Recovery(n, cfg.recovery, self._period, self._rng)
        self.poses, self.map_error = np.zeros((n, 3)), np.zeros(n)
        self._state = _State(
            np.ones(n, dtype=bool),
            np.zeros(n, int),
            np.zeros((n, 2)),
            np.zeros((n, 2)),
            np.zeros((n, 2)),
            np.zeros(n, int),
        )

    def reset(self, dones: torch.Tensor | None = None) -> None:
        """Forget the worlds in a mask (num_envs,), or all: their places are mapped before they drive on."""
        self._state.fresh |= True if dones is None else dones.cpu().numpy().astype(bool)

    def __call__(self, obs: TensorDict) -> torch.Tensor:
        """Return actions, shape (num_envs, 10)."""
        ranges, odometry, goal = (
            obs[name].cpu().numpy().astype(np.float64) for name in ("lidar", "odometry", "goal")
        )
        state = self._state
        if 2 * state.fresh.sum() >= len(state.fresh):
            self._begin(goal[:, :2] * GOAL_SCALE_M)
        drives = ~state.fresh
        self._turn.add(ranges, odometry)
        points, counts = self._turn.hits(odometry, self._model.far_m)
        self._filter.update(drives & self._turn.complete, odometry, points, counts)
        self.poses = self._filter.pose(odometry)
        self._remember(ranges)
        self._plan(drives)
        command = self._drive(odometry, drives)
        command[(state.step * self._period < self.settings.stow_s) | ~drives] = 0.0
        state.step += 1
        state.command = command
        return self._actions(self._executed(command))

    def _begin(self, goal: np.ndarray) -> None:
        """Map the places of fresh worlds and put the robots at their starts."""
        state, cfg = self._state, self.settings
        fresh = state.fresh.copy()
        state.goal[fresh] = goal[fresh]
        errors = self._mapping.run(fresh, self._lidar.survey(), state.goal, self._rng)
        self.map_error[fresh] = errors[fresh]
        self.maps.finish_map(fresh, cfg.localization)
        self._turn.restart(fresh)
        self._filter.restart(fresh)
        self.recovery.restart(fresh)
        for memory in (state.step, state.command, state.error, state.news):
            memory[fresh] = 0
        self.ways.plan(fresh, state.goal)
        state.fresh[:] = False

    def _remember(self, ranges: np.ndarray) -> None:
        """Mark and clear what the step's beams show."""
        cfg = self.settings.planner
        ends, kinds = self._model.limited(ranges, cfg.mark_m, cfg.clear_m)
        laser = np.broadcast_to(self._model.position, (len(ranges), 2))
        state = self._state
        known = ~state.fresh & (state.step >= self.settings.localization.first_updates)
        start, ends = to_frame_of(self.poses, laser), to_frame_of(self.poses[:, None, :], ends)
        self.maps.add_live(known, start, ends, kinds, cfg)

    def _plan(self, drives: np.ndarray) -> None:
        """Plan anew where it is time, of the worlds in a mask; and let it be seen who gets no nearer."""
        state, n = self._state, len(self.poses)
        often, seldom = (
            max(round(seconds / self._period), 1)
            for seconds in (self.settings.planner.period_s, self.settings.planner.oldest_s)
        )
        turn = state.step + np.arange(n)
        looked = drives & (turn % often == 0)
        news = self.maps.news(looked, self.settings.localization)
        due = looked & ((news != state.news) | (turn % seldom == 0))
        state.news[due] = news[due]
        self.ways.plan(due, state.goal)
        _, way = self.ways.lookahead(drives, self.poses, 0.0)
        cleared = self.recovery.watch(way, due)
        if cleared.any():
            self.maps.forget_live(cleared)
            self.ways.plan(cleared, state.goal)

    def _drive(self, odometry: np.ndarray, drives: np.ndarray) -> np.ndarray:
        """Speeds of the follower, or of a recovery where it is clear; shape (n, 2)."""
        follower, recovery = self._follower, self.recovery
        points, counts = self._turn.hits(odometry, follower.reach_m, thinned=True)
        counts = np.where(drives, counts, 0)
        points = points[:, : max(int(counts.max()), 1)]
        seen = (self.poses, self.ways.field, points, counts)
        turn = np.stack((np.zeros(len(drives)), 0.5 * self._profile.turn_max * recovery.side), axis=1)
        back = np.tile((-self._profile.reverse_max, 0.0), (len(drives), 1))
        recovering = (recovery.mode == ROTATING) | (recovery.mode == BACKING)
        given = np.where((recovery.mode == ROTATING)[:, None], turn, back)
        clear = recovering & follower.is_clear(*seen, given) if recovering.any() else recovering
        command = follower.choose(*seen, self._state.command, recovering)
        return np.where(clear[:, None], given, command)

    def _executed(self, command: np.ndarray) -> np.ndarray:
        """Speeds with the errors of floor and wheels, which last for some time."""
        cfg, state = self.settings, self._state
        kept = np.exp(-self._period / cfg.execution_time_s)
        drawn = self._rng.standard_normal(state.error.shape)
        state.error = kept * state.error + np.sqrt(1.0 - kept**2) * cfg.execution_error * drawn
        return command * (1.0 + state.error)

    def _actions(self, speeds: np.ndarray) -> torch.Tensor:
        """Actions for speeds; those of the joints are 0, the stowed pose."""
        profile = self._profile
        most = np.where(speeds[:, 0] >= 0.0, profile.forward_max, profile.reverse_max)
        actions = np.zeros((len(speeds), len(robot.ACTIONS)), dtype=np.float32)
        actions[:, 0] = speeds[:, 0] / most
        actions[:, 1] = speeds[:, 1] / profile.turn_max
        return torch.as_tensor(actions, device=self._device).clamp_(-1.0, 1.0)


def by_map_alone(device: str) -> LidarStack:
    """Make a stack that plans through the map of the mapping drive, and marks nothing that it sees later.

    It still drives into nothing that the last turn of the lidar shows.

    Args:
        device: Of the actions.
    """
    return LidarStack(device, StackSettings(planner=PlannerSettings(mark_m=0.0)))
