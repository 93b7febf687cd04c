"""What all tasks share: one captured graph per control step, seeds, training levels, saving, statistics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol, TypeVar

import torch
import warp as wp
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from spin_rl import robot
from spin_rl.scenes.corridors.params import GeneratorParams
from spin_rl.scenes.tabletops.params import TabletopParams
from spin_rl.sim import Simulation
from spin_rl.sim.graph import StepGraph, torch_order
from spin_rl.tasks.common import episode
from spin_rl.tasks.common.config import CurriculumConfig, TaskConfig
from spin_rl.tasks.common.depth import DepthImages
from spin_rl.tasks.common.health import HealthMonitor
from spin_rl.tasks.common.proprioception import CAMERA_ACTIONS, camera_columns
from spin_rl.tasks.common.rewards import Motion, Term
from spin_rl.tasks.common.statistics import EpisodeStatistics

Scene = TypeVar("Scene", GeneratorParams, TabletopParams)


class Observations(Protocol):
    """The observation groups of a task, and the state of their noise."""

    def compute(self) -> TensorDict:
        """Return new tensors of all groups."""
        ...

    def reseed(self, seed: int) -> None:
        """Restart the noise generator."""
        ...

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Return the state of the noise generator."""
        ...

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore it."""
        ...


class TaskEnv(VecEnv):
    """A task in all worlds at once, as an rsl_rl vector environment.

    One captured graph per step runs physics, ends episodes, draws new scenes for the worlds that ended and
    updates the sensors; rewards and observations are Torch functions of the same memory. Observations
    returned by `step` are those of the new episode where one ended; `last_transition` and `outcome` describe
    the step itself.

    A subclass hands its simulation to the constructor, makes its sensors, `observations` and `statistics`,
    and calls `_begin` at last. `_launch_step` and `_launch_reset` only launch kernels.
    """

    camera_actions = CAMERA_ACTIONS
    camera_columns = camera_columns()
    observations: Observations
    statistics: EpisodeStatistics
    last_transition: Motion | None = None

    def __init__(
        self,
        cfg: TaskConfig,
        sim: Simulation,
        seed: int,
        reward: Mapping[str, float],
        terms: Mapping[str, Term],
        camera_action: torch.Tensor | None,
    ) -> None:
        """Allocate what every task needs.

        Args:
            cfg: Task configuration.
            sim: The simulation.
            seed: Seed of scenes, start poses and dynamics.
            reward: Scale by term.
            terms: Functions of what `_transition` returns.
            camera_action: Actions that hold a frozen camera, shape (2,), or None.
        """
        self.sim = sim
        self.num_envs = sim.nworld
        self.num_actions = len(robot.ACTIONS)
        self.device = sim.device
        self.max_episode_length = round(cfg.episode_s / cfg.sim.control_period)
        self.camera_site = sim.mj_model.site("camera_depth_optical_frame").id
        self.tan_half_fov = robot.camera_tan_half_fov(cfg.camera_mount)
        self._task = cfg
        # A disabled curriculum stays where it starts.
        self._moves = cfg.curriculum if cfg.curriculum.enabled else CurriculumConfig(up=0.0, down=0.0)
        self._reward_scales = dict(reward)
        self._terms = terms
        self._camera_action = camera_action
        with wp.ScopedDevice(self.device):
            self._allocate_shared(cfg, seed)
        self.episode_length_buf = wp.to_torch(self._episode_length)
        self.outcome = wp.to_torch(self._outcome)
        self.level = wp.to_torch(self._level)
        # At the end of the last step, before worlds that ended were reset, shape (num_envs, nq) and
        # (num_envs, nv).
        self.final_qpos = wp.to_torch(self._final_qpos)
        self.final_qvel = wp.to_torch(self._final_qvel)
        self._done_view = wp.to_torch(self._done)
        self._last_action = torch.zeros_like(sim.views.action)
        self._zero = torch.zeros(self.num_envs, device=self.device)
        self.depth: DepthImages | None = None
        if cfg.depth is not None:
            self.depth = DepthImages(
                sim, cfg.depth, camera_site=self.camera_site, tan_half_fov=self.tan_half_fov, seed=self._seed
            )
        self.health = HealthMonitor(sim, self._outcome)

    def _allocate_shared(self, cfg: TaskConfig, seed: int) -> None:
        n = self.num_envs
        self._level = wp.full(n, cfg.curriculum.start, dtype=float)
        self._layout_counter = wp.zeros(n, dtype=wp.int32)
        self._seed = wp.array([seed], dtype=wp.int32)
        self._counter = wp.zeros(n, dtype=wp.int32)
        self._lag_range = wp.array([cfg.dynamics.base_lag_s, cfg.dynamics.joint_lag_s], dtype=float)
        self._speed_range = wp.array(cfg.dynamics.speed_scale, dtype=float)
        self._episode_length = wp.zeros(n, dtype=wp.int32)
        self._final_qpos = wp.zeros_like(self.sim.data.qpos)
        self._final_qvel = wp.zeros_like(self.sim.data.qvel)
        self._outcome = wp.zeros(n, dtype=wp.int32)
        self._done = wp.zeros(n, dtype=bool)
        self._all = wp.full(n, True, dtype=bool)

    def _begin(self, seed: int, capture: bool) -> None:
        """Compile every kernel, start every episode and capture the step."""
        # The eager pass compiles; its step is undone by the reset.
        with torch_order(self.device):
            self._launch_step()
            self.health.clear()
        self.reseed(seed)
        self.reset()
        self._graph = StepGraph(self._launch_step, self.device, capture=capture)

    def _launch_step(self) -> None:
        """Everything of one control step that happens on the device before rewards and observations."""
        raise NotImplementedError

    def _launch_reset(self, mask: wp.array) -> None:
        """Start new episodes in the masked worlds, shape (nworld,), bool, and update the sensors of all."""
        raise NotImplementedError

    def _before_step(self) -> None:
        """Keep what the step will overwrite and rewards need."""

    def _transition(self, action: torch.Tensor) -> Motion:
        """Describe the step that was made with an action, shape (num_envs, 10)."""
        raise NotImplementedError

    def _time_outs(self) -> torch.Tensor:
        """Episodes that the time limit ended in this step, shape (num_envs,), bool."""
        return self.outcome == episode.TIMEOUT

    def reseed(self, seed: int) -> None:
        """Restart random numbers and levels; after a reset all is as in a new environment with this seed."""
        self.level.fill_(self._task.curriculum.start)
        self._seed.fill_(seed)
        self.set_episode(0)
        self.observations.reseed(seed)

    def set_episode(self, index: int) -> None:
        """Let the next reset draw the `index`-th episode of this seed in every world."""
        self._layout_counter.fill_(index)
        self._counter.fill_(index)
        if self.depth is not None:
            self.depth.set_episode(index)

    def reset(self) -> TensorDict:
        """Start a new episode in every world and return its first observations."""
        with torch_order(self.device):
            self._launch_reset(self._all)
            self.health.restart()
        self.statistics.restart()
        return self.get_observations()

    def get_observations(self) -> TensorDict:
        """Return the current observation groups, each of shape (num_envs, dim), float32."""
        return self.observations.compute()

    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict]:
        """Apply actions for one control period.

        Args:
            actions: In [-1, 1] (clipped), `robot.ACTIONS` order, shape (num_envs, 10).

        Returns:
            Observations, rewards (num_envs,), dones (num_envs,) int64, and extras with `time_outs`
            (num_envs,) bool.
        """
        action_view = self.sim.views.action
        self._last_action.copy_(action_view)
        self._before_step()
        action_view.copy_(actions.clamp(-1.0, 1.0))
        if self._camera_action is not None:
            action_view[:, -len(robot.CAMERA_JOINTS) :] = self._camera_action
        # A world with a non-finite action is reset; its reward shall be finite.
        action = action_view.nan_to_num(0.0)
        self._graph.replay()

        transition = self.last_transition = self._transition(action)
        terms = {name: scale * self._terms[name](transition) for name, scale in self._reward_scales.items()}
        reward = torch.stack([self._zero, *terms.values()]).sum(0)
        self.statistics.add(self, reward, terms)
        extras = {"time_outs": self._time_outs()}
        return self.get_observations(), reward, self._done_view.long(), extras

    def episode_stats(self) -> dict[str, float]:
        """Read and clear what happened since the last call; the only call here that waits for the device."""
        stats = self.statistics.read()
        stats["level"] = float(self.level.mean())
        with torch_order(self.device):
            return stats | self.health.read()

    def dump_non_finite(self, folder: Path) -> list[Path]:
        """Write the recent states of worlds that turned non-finite since the last call; return the files."""
        with torch_order(self.device):
            return self.health.dump(folder)

    def state_dict(self) -> dict[str, Any]:
        """Return what a resumed training needs: curriculum levels and random-number counters."""
        state = {
            "level": self.level.cpu().clone(),
            "layout_counter": wp.to_torch(self._layout_counter).cpu().clone(),
            "dynamics_counter": wp.to_torch(self._counter).cpu().clone(),
        }
        if self.depth is not None:
            state["depth_counter"] = self.depth.counter.cpu().clone()
        return state | self.observations.state_dict()

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state_dict` and start new episodes; another number of worlds keeps the mean level."""
        saved = state["level"]
        if saved.shape[0] == self.num_envs:
            self.level.copy_(saved)
            wp.to_torch(self._layout_counter).copy_(state["layout_counter"])
            wp.to_torch(self._counter).copy_(state["dynamics_counter"])
            if self.depth is not None and "depth_counter" in state:
                self.depth.counter.copy_(state["depth_counter"])
        else:
            self.level.fill_(float(saved.mean()))
        self.observations.load_state_dict(state)
        self.reset()


def with_camera_at(scene: Scene, pose: tuple[float, float] | None) -> Scene:
    """Return parameters of a generator whose robots start with head pan and tilt [rad] at a pose, if any."""
    if pose is None:
        return scene
    pan, tilt = pose
    return replace(scene, start_head_pan=(pan, pan), start_head_tilt=(tilt, tilt))
