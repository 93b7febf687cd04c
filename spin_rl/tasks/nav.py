"""The navigation task: drive through clutter to a goal, seeing only what the camera sees (SPIN 2.1.2)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import torch
import warp as wp
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from spin_rl import robot
from spin_rl.scenes.generator import generate_layouts
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.sensors.clearance import Clearance
from spin_rl.sensors.scandots import Scandots
from spin_rl.sim import Simulation
from spin_rl.sim.graph import StepGraph
from spin_rl.tasks import episode, rewards
from spin_rl.tasks.config import CurriculumConfig, NavConfig
from spin_rl.tasks.depth import DepthImages
from spin_rl.tasks.health import HealthMonitor
from spin_rl.tasks.observations import CAMERA_ACTIONS, CAMERA_JOINTS, NavObservations, camera_columns
from spin_rl.tasks.statistics import EpisodeStatistics


class NavEnv(VecEnv):
    """Navigation in all worlds at once, as an rsl_rl vector environment.

    One captured graph per step runs physics, ends episodes, draws new layouts for the worlds that ended and
    updates the sensors; rewards and observations are Torch functions of the same memory. Observations
    returned by `step` are those of the new episode where one ended; `last_transition` and `outcome` describe
    the step itself. The observation groups are documented in `observations.py`.
    """

    camera_actions = CAMERA_ACTIONS
    camera_columns = camera_columns()

    def __init__(
        self,
        cfg: NavConfig,
        num_envs: int,
        device: str = "cpu",
        seed: int = 0,
        *,
        scene: Scene | None = None,
        capture: bool = True,
    ) -> None:
        """Allocate all worlds, compile kernels and start every episode.

        Args:
            cfg: Task configuration.
            num_envs: Number of worlds.
            device: Warp and Torch device.
            seed: Seed of layouts, start poses, dynamics and sensor noise.
            scene: A fixed scene for every world and episode instead of the generator's corridors.
            capture: False launches kernels eagerly.
        """
        if num_envs < 1:
            raise ValueError(f"num_envs must be at least 1, got {num_envs}")
        self.cfg = cfg
        self.num_envs = num_envs
        self.num_actions = len(robot.ACTIONS)
        self.device = device
        self.max_episode_length = round(cfg.episode_s / cfg.sim.control_period)
        self._scene = scene
        self._layout_params = cfg.scene
        self._camera_action = None
        if cfg.camera_pose is not None:
            pan, tilt = cfg.camera_pose
            self._layout_params = replace(cfg.scene, start_head_pan=(pan, pan), start_head_tilt=(tilt, tilt))
            self._camera_action = torch.tensor(
                [robot.action_of(*pose) for pose in zip(CAMERA_JOINTS, cfg.camera_pose, strict=True)],
                device=device,
            )
        pool = PoolSpec() if scene is None else scene.pool
        profile, moving = robot.SPEED_PROFILES[cfg.robot_profile], (scene or cfg.scene).moves
        self.sim = Simulation(num_envs, pool, profile, cfg.sim, device, moving=moving)
        if scene is not None:
            self.sim.layout.load(scene)
        with wp.ScopedDevice(device):
            self._allocate(cfg, seed)
        camera_site = self.sim.mj_model.site("camera_depth_optical_frame").id
        tan_half_fov = robot.camera_tan_half_fov(cfg.camera_mount)
        self.scandots = Scandots(
            self.sim.layout,
            qpos=self.sim.data.qpos,
            site_xpos=self.sim.data.site_xpos,
            site_xmat=self.sim.data.site_xmat,
            camera_site=camera_site,
            tan_half_fov=tan_half_fov,
            window=cfg.scandots.window_m,
            near=cfg.scandots.near_m,
            occlusion=cfg.scandots.occlusion,
        )
        self.depth: DepthImages | None = None
        if cfg.depth is not None:
            self.depth = DepthImages(
                self.sim, cfg.depth, camera_site=camera_site, tan_half_fov=tan_half_fov, seed=self._seed
            )
        self.health = HealthMonitor(self.sim, self._outcome)
        self.observations = NavObservations(self.sim, self.scandots, cfg.noise, seed, self.depth)
        self.statistics = EpisodeStatistics(num_envs, tuple(rewards.check_scales(cfg.reward)), device)
        self._reward_scales = rewards.check_scales(cfg.reward)
        self._clearance = Clearance(self.sim, cfg.clearance_m) if "clearance" in self._reward_scales else None
        self.last_transition: rewards.Transition | None = None
        self._make_views()
        # The eager pass compiles every kernel; its step is undone by the reset.
        with wp.ScopedDevice(device):
            self._launch_step()
        self.health.clear()
        self.reseed(seed)
        self.reset()
        self._graph = StepGraph(self._launch_step, device, capture=capture)

    def _allocate(self, cfg: NavConfig, seed: int) -> None:
        n = self.num_envs
        self._scenario_choice = wp.full(n, cfg.scenario, dtype=wp.int32)
        self._difficulty_choice = wp.full(n, cfg.difficulty, dtype=wp.int32)
        self._level = wp.full(n, cfg.curriculum.start, dtype=float)
        self._layout_counter = wp.zeros(n, dtype=wp.int32)
        self._seed = wp.array([seed], dtype=wp.int32)
        self._counter = wp.zeros(n, dtype=wp.int32)
        self._lag_range = wp.array([cfg.dynamics.base_lag_s, cfg.dynamics.joint_lag_s], dtype=float)
        self._speed_range = wp.array(cfg.dynamics.speed_scale, dtype=float)
        self._episode_length = wp.zeros(n, dtype=wp.int32)
        self._distance = wp.zeros(n, dtype=float)
        self._progress = wp.zeros(n, dtype=float)
        self._goal_distance = wp.zeros(n, dtype=float)
        self._final_qpos = wp.zeros_like(self.sim.data.qpos)
        self._final_qvel = wp.zeros_like(self.sim.data.qvel)
        self._outcome = wp.zeros(n, dtype=wp.int32)
        self._done = wp.zeros(n, dtype=bool)
        self._all = wp.full(n, True, dtype=bool)

    def _make_views(self) -> None:
        self.episode_length_buf = wp.to_torch(self._episode_length)
        self.outcome = wp.to_torch(self._outcome)
        self.level = wp.to_torch(self._level)
        # Positions at the end of the last step, before worlds that ended were reset, shape (num_envs, 13).
        self.final_qpos = wp.to_torch(self._final_qpos)
        self._views = {
            "progress": wp.to_torch(self._progress),
            "goal_distance": wp.to_torch(self._goal_distance),
            "qpos": self.final_qpos,
            "qvel": wp.to_torch(self._final_qvel),
            "done": wp.to_torch(self._done),
        }
        # The goal before the step: layouts of worlds that ended have changed when rewards are computed.
        self._goal_before = torch.zeros_like(self.sim.views.goal)
        self._last_action = torch.zeros_like(self.sim.views.action)
        no_haste = torch.zeros_like(self._views["progress"])
        self._haste = no_haste if self._clearance is None else wp.to_torch(self._clearance.haste)

    def _launch_step(self) -> None:
        """Everything of one control step that happens on the device before rewards and observations."""
        sim, cfg = self.sim, self.cfg
        sim.advance()
        if self._clearance is not None:
            self._clearance.update()
        moves = cfg.curriculum if cfg.curriculum.enabled else CurriculumConfig(up=0.0, down=0.0)
        wp.launch(
            episode._end_episodes,
            dim=self.num_envs,
            inputs=[
                sim.data.qpos,
                sim.data.qvel,
                sim.action,
                sim.layout.goal,
                sim.layout.bend,
                sim.contacts.parts,
                cfg.goal_tolerance_m,
                self.max_episode_length,
                cfg.stop_on_collision,
                moves.up,
                moves.down,
                self._episode_length,
                self._distance,
                self._level,
            ],
            outputs=[
                self._progress,
                self._goal_distance,
                self._final_qpos,
                self._final_qvel,
                self._outcome,
                self._done,
            ],
        )
        self.health.launch()
        self._launch_reset(self._done)

    def _launch_reset(self, mask: wp.array) -> None:
        sim = self.sim
        if self._scene is None:
            generate_layouts(
                sim.layout,
                self._layout_params,
                seed=self._seed,
                counter=self._layout_counter,
                mask=mask,
                scenario_choice=self._scenario_choice,
                difficulty_choice=self._difficulty_choice,
                level=self._level,
            )
        sim.reset(mask)
        wp.launch(
            episode._begin_episodes,
            dim=self.num_envs,
            inputs=[
                mask,
                sim.data.qpos,
                sim.layout.goal,
                sim.layout.bend,
                self._seed,
                self._lag_range,
                self._speed_range,
                self._counter,
            ],
            outputs=[self._episode_length, self._distance, sim.dynamics.lag, sim.dynamics.speed_scale],
        )
        if self.depth is not None:
            self.depth.begin(mask)
        sim.forward()
        self.scandots.update()
        if self.depth is not None:
            self.depth.update()

    def _launch_reset_all(self) -> None:
        self._launch_reset(self._all)

    def set_cells(self, scenario: torch.Tensor | list[int], difficulty: torch.Tensor | list[int]) -> None:
        """Fix scenario and difficulty of every world, from its next episode on.

        Args:
            scenario: 1 straight, 2 L-shaped, 0 a mix, shape (num_envs,).
            difficulty: 0 easy, 1 medium, 2 hard, -1 a mix, shape (num_envs,).
        """
        for name, values in (("scenario", scenario), ("difficulty", difficulty)):
            view = wp.to_torch(getattr(self, f"_{name}_choice"))
            view.copy_(torch.as_tensor(values, dtype=torch.int32))

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

    def reset(self) -> TensorDict:
        """Start a new episode in every world and return its first observations."""
        with wp.ScopedDevice(self.device):
            self._launch_reset_all()
        self.statistics.restart()
        self.health.restart()
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
        self._goal_before.copy_(self.sim.views.goal)
        action_view.copy_(actions.clamp(-1.0, 1.0))
        if self._camera_action is not None:
            action_view[:, -len(CAMERA_JOINTS) :] = self._camera_action
        # A world with a non-finite action is reset; its reward shall be finite.
        action = action_view.nan_to_num(0.0)
        self._graph.replay()

        self.last_transition = self._transition(action)
        terms = {
            name: scale * rewards.TERMS[name](self.last_transition)
            for name, scale in self._reward_scales.items()
        }
        reward = torch.stack([torch.zeros_like(self.last_transition.progress), *terms.values()]).sum(0)
        timeout = self.outcome == episode.TIMEOUT
        done = self._views["done"]
        self.statistics.add(self, reward, terms)
        return self.get_observations(), reward, done.long(), {"time_outs": timeout}

    def _transition(self, action: torch.Tensor) -> rewards.Transition:
        qpos, qvel = self._views["qpos"], self._views["qvel"]
        to_goal = self._goal_before - qpos[:, :2]
        direction = to_goal / to_goal.norm(dim=-1, keepdim=True).clamp_min(1e-6)
        return rewards.Transition(
            progress=self._views["progress"],
            goal_distance=self._views["goal_distance"],
            goal_speed=(qvel[:, :2] * direction).sum(-1),
            qvel=qvel,
            success=self.outcome == episode.SUCCESS,
            collision=self.sim.views.part_contacts.any(-1),
            self_contact=self.sim.views.self_contact,
            action=action,
            last_action=self._last_action,
            haste=self._haste,
        )

    def episode_stats(self) -> dict[str, float]:
        """Read and clear what happened since the last call; the only call here that waits for the device."""
        stats = self.statistics.read()
        stats["level"] = float(self.level.mean())
        return stats | self.health.read()

    def dump_non_finite(self, folder: Path) -> list[Path]:
        """Write the recent states of worlds that turned non-finite since the last call; return the files."""
        return self.health.dump(folder)

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Return what a resumed training needs: curriculum levels and random-number counters."""
        state = {
            "level": self.level.cpu().clone(),
            "layout_counter": wp.to_torch(self._layout_counter).cpu().clone(),
            "dynamics_counter": wp.to_torch(self._counter).cpu().clone(),
        }
        if self.depth is not None:
            state["depth_counter"] = self.depth.counter.cpu().clone()
        return state | self.observations.state_dict()

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
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
