"""What all tasks share: one captured graph per control step, seeds, training levels, saving, statistics.

One class, and so one file: the order of what happens in a step and in a reset is its subject. The parts are
elsewhere: physics, sensors, rewards, observations, statistics, health.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol, TypeVar

import torch
import warp as wp
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from spin_rl import robot
from spin_rl.scenes.corridors.params import GeneratorParams
from spin_rl.scenes.layout import PoolSpec
from spin_rl.scenes.tabletops.params import TabletopParams
from spin_rl.sensors.interface import Sensor
from spin_rl.sim.graph import StepGraph, torch_order
from spin_rl.sim.simulation import Simulation
from spin_rl.sim.targets import ManipulationConfig
from spin_rl.tasks.common import episode, rewards
from spin_rl.tasks.common.config import CurriculumConfig, TaskConfig
from spin_rl.tasks.common.depth import DepthImages
from spin_rl.tasks.common.health import HealthMonitor
from spin_rl.tasks.common.proprioception import CAMERA_ACTIONS, camera_columns
from spin_rl.tasks.common.rewards import Term, Transition
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

    A subclass makes its sensors, `observations` and `statistics`, and calls `_begin` at last. Its methods
    `_end_episodes`, `_draw_scenes` and `_begin_episodes` only launch kernels.

    Attributes:
        sensors: What observations read; updated at the end of a step, with new episodes' scenes and poses.
        step_sensors: What rewards read; updated after physics, before worlds that ended are reset.
        outcomes: Names of the values of `outcome`.
        stages: Names of the values of `stage`, where episodes have stages.
    """

    camera_actions = CAMERA_ACTIONS
    camera_columns = camera_columns()
    cfg: TaskConfig
    device: str
    max_episode_length: int
    sensors: tuple[Sensor, ...] = ()
    step_sensors: tuple[Sensor, ...] = ()
    outcomes: tuple[str, ...] = episode.OUTCOMES
    stages: tuple[str, ...] = ()
    observations: Observations
    statistics: EpisodeStatistics
    last_transition: Transition | None = None
    _keeps_ends = False
    _reset_graph: StepGraph | None = None

    def __init__(
        self,
        cfg: TaskConfig,
        num_envs: int,
        device: str,
        seed: int,
        *,
        pool: PoolSpec,
        terms: Mapping[str, Term],
        camera_action: Sequence[float],
        moving: bool = False,
        manipulation: ManipulationConfig | None = None,
    ) -> None:
        """Allocate what every task needs.

        Args:
            cfg: Task configuration.
            num_envs: Number of worlds.
            device: Warp and Torch device.
            seed: Seed of scenes, start poses and dynamics.
            pool: Scene geoms of every world.
            terms: Reward terms, functions of what `_transition` returns.
            camera_action: Actions that hold the camera at `cfg.camera_pose`, if there is one.
            moving: Whether obstacles may move.
            manipulation: See `Simulation`.
        """
        if num_envs < 1:
            raise ValueError(f"num_envs must be at least 1, got {num_envs}")
        self._reward_scales = rewards.check_scales(cfg.reward, terms)
        own = self._reward_scales.keys() - terms.keys()
        self._terms = {**terms, **{name: rewards.outside_term(name) for name in own}}
        self.cfg = cfg
        profile = robot.SPEED_PROFILES[cfg.robot_profile]
        self.sim = Simulation(
            num_envs, pool, profile, cfg.sim, device, moving=moving, manipulation=manipulation
        )
        self.num_envs = num_envs
        self.num_actions = len(robot.ACTIONS)
        self.device = device
        self.max_episode_length = round(cfg.episode_s / cfg.sim.control_period)
        # A disabled curriculum stays where it starts.
        self._moves = cfg.curriculum if cfg.curriculum.enabled else CurriculumConfig(up=0.0, down=0.0)
        self._camera_action = None
        if cfg.camera_pose is not None:
            self._camera_action = torch.tensor(camera_action, device=device)
        with wp.ScopedDevice(device):
            self._allocate_shared(cfg, seed)
        self.episode_length_buf = wp.to_torch(self._episode_length)
        self.outcome = wp.to_torch(self._end.outcome)
        self.level = wp.to_torch(self._level)
        # At the end of the last step, before worlds that ended were reset, shape (num_envs, nq) and
        # (num_envs, nv).
        self.final_qpos = wp.to_torch(self._end.qpos)
        self.final_qvel = wp.to_torch(self._end.qvel)
        self._done_view = wp.to_torch(self._end.done)
        self._last_action = torch.zeros_like(self.sim.views.action)
        self._zero = torch.zeros(num_envs, device=device)
        self.depth: DepthImages | None = None
        if cfg.depth is not None:
            self.depth = DepthImages(self.sim, cfg.depth, camera_mount=cfg.camera_mount, seed=self._seed)
        self.health = HealthMonitor(self.sim, self._end.outcome)

    def _allocate_shared(self, cfg: TaskConfig, seed: int) -> None:
        n = self.num_envs
        self._level = wp.full(n, cfg.curriculum.start, dtype=float)
        self._layout_counter = wp.zeros(n, dtype=wp.int32)
        self._seed = wp.array([seed], dtype=wp.int32)
        self._counter = wp.zeros(n, dtype=wp.int32)
        self._lag_range = wp.array([cfg.dynamics.base_lag_s, cfg.dynamics.joint_lag_s], dtype=float)
        self._scale_range = wp.array([cfg.dynamics.speed_scale, cfg.dynamics.acceleration_scale], dtype=float)
        self._episode_length = wp.zeros(n, dtype=wp.int32)
        self._end = episode.StepEnd()
        self._end.qpos = wp.zeros_like(self.sim.data.qpos)
        self._end.qvel = wp.zeros_like(self.sim.data.qvel)
        self._end.outcome = wp.zeros(n, dtype=wp.int32)
        self._end.done = wp.zeros(n, dtype=bool)
        self._all = wp.full(n, True, dtype=bool)
        self._chosen = wp.zeros(n, dtype=bool)  # worlds to reset beside the step

    def _begin(
        self,
        seed: int,
        capture: bool,
        *,
        sensors: Sequence[Sensor | None],
        step_sensors: Sequence[Sensor | None] = (),
    ) -> None:
        """Compile every kernel, start every episode and capture the step; None is a sensor not in use."""
        self.sensors = tuple(sensor for sensor in sensors if sensor is not None)
        self.step_sensors = tuple(sensor for sensor in step_sensors if sensor is not None)
        # The eager pass compiles; its step is undone by the reset.
        with torch_order(self.device):
            self._launch_step()
            self.health.clear()
        self.reseed(seed)
        self.reset()
        self._capture = capture
        self._graph = StepGraph(self._launch_step, self.device, capture=capture)

    def _launch_step(self) -> None:
        """Everything of one control step that happens on the device before rewards and observations."""
        self._before_advance()
        self.sim.advance()
        for sensor in self.step_sensors:
            sensor.update()
        self._end_episodes()
        self.health.launch()
        if self._keeps_ends:
            wp.launch(
                episode.choose_non_finite,
                dim=self.num_envs,
                inputs=[self._end.outcome],
                outputs=[self._chosen],
            )
            self._launch_reset(self._chosen)
        else:
            self._launch_reset(self._end.done)

    def _launch_reset(self, mask: wp.array) -> None:
        """Start new episodes in the masked worlds, shape (nworld,), bool, and update the sensors of all."""
        self._draw_scenes(mask)
        self.sim.reset(mask)
        self._begin_episodes(mask)
        for sensor in (*self.step_sensors, *self.sensors):
            sensor.begin(mask)
        self.sim.forward()
        for sensor in self.sensors:
            sensor.update()

    def _before_advance(self) -> None:
        """Launch what may still change the actions; graph-safe."""

    def _end_episodes(self) -> None:
        """Describe the control step just made, write `_end`, and move levels."""
        raise NotImplementedError

    def _draw_scenes(self, mask: wp.array) -> None:
        """Write the layouts of the masked worlds' new episodes."""
        raise NotImplementedError

    def _begin_episodes(self, mask: wp.array) -> None:
        """Draw the masked worlds' dynamics; subclasses also clear what they remember of the last episodes."""
        dynamics = self.sim.dynamics
        wp.launch(
            episode.begin,
            dim=self.num_envs,
            inputs=[mask, self._seed, self._lag_range, self._scale_range, self._counter],
            outputs=[
                self._episode_length,
                dynamics.lag,
                dynamics.speed_scale,
                dynamics.acceleration_scale,
            ],
        )

    def _before_step(self) -> None:
        """Keep what the step will overwrite and rewards need."""

    def _set_camera(self, action: torch.Tensor) -> None:
        """Replace the camera's actions, a view of shape (num_envs, 2), where they are not the policy's."""
        if self._camera_action is not None:
            action[:] = self._camera_action

    def _transition(self, action: torch.Tensor) -> Transition:
        """Describe the step that was made with an action, shape (num_envs, 10)."""
        raise NotImplementedError

    def _time_outs(self) -> torch.Tensor:
        """Episodes that the time limit ended in this step, shape (num_envs,), bool."""
        return self.outcome == episode.TIMEOUT

    def reseed(self, seed: int) -> None:
        """Restart random numbers and levels; after a reset all is as in a new environment with this seed."""
        self.level.fill_(self.cfg.curriculum.start)
        self._seed.fill_(seed)
        self.set_episode(0)
        self.observations.reseed(seed)

    def set_episode(self, index: int) -> None:
        """Let the next reset draw the `index`-th episode of this seed in every world."""
        self._layout_counter.fill_(index)
        self._counter.fill_(index)
        if self.depth is not None:
            self.depth.set_episode(index)

    def depth_ranges(self) -> torch.Tensor:
        """Return the depths that every world's image shows as nearest and farthest [m], (num_envs, 2).

        There is a depth camera.
        """
        assert self.cfg.depth is not None
        read = self.cfg.depth.filter
        near_far = torch.tensor([read.near_m, read.far_m], dtype=torch.float64, device=self.device)
        return near_far.repeat(self.num_envs, 1)

    def reset(self) -> TensorDict:
        """Start a new episode in every world and return its first observations."""
        with torch_order(self.device):
            self._launch_reset(self._all)
            self.health.restart()
        self.statistics.restart()
        return self.get_observations()

    def keep_ends(self) -> None:
        """From now on leave worlds whose episode ends as they are: `reset_worlds` starts them anew.

        Observations are then those of the last state. Only worlds that turned non-finite start anew at once.
        Captures the step again.
        """
        self._keeps_ends = True
        self._graph = StepGraph(self._launch_step, self.device, capture=self._capture)

    def reset_worlds(self, mask: torch.Tensor) -> TensorDict:
        """Start new episodes in some worlds; the others go on where they are.

        Args:
            mask: Which, shape (num_envs,), bool.

        Returns:
            New observations of these worlds, beside the present ones of the others.
        """
        if self._reset_graph is None:
            self._reset_graph = StepGraph(
                lambda: self._launch_reset(self._chosen), self.device, capture=self._capture
            )
        wp.to_torch(self._chosen).copy_(mask)
        self._reset_graph.replay()
        self.statistics.restart(mask)
        present, chosen = self._observed, mask[:, None]
        new = self.get_observations()
        for name in new.keys():
            new[name] = torch.where(chosen, new.get(name), present.get(name))
        return self._observed

    def get_observations(self) -> TensorDict:
        """Return the current observation groups, each of shape (num_envs, dim), float32."""
        self._observed = self.observations.compute()
        return self._observed

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
        self._set_camera(action_view[:, -len(robot.CAMERA_JOINTS) :])
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
