"""The navigation task: drive through clutter to a goal, seeing only what the camera sees (SPIN 2.1.2)."""

from __future__ import annotations

import torch
import warp as wp

from spin_rl import robot
from spin_rl.scenes.corridors.generator import generate_layouts
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.sensors.clearance import Clearance
from spin_rl.sensors.scandots import Scandots
from spin_rl.sim import Simulation
from spin_rl.tasks.common import episode, rewards
from spin_rl.tasks.common.config import NavConfig
from spin_rl.tasks.common.env import TaskEnv, with_camera_at
from spin_rl.tasks.common.statistics import NavStatistics
from spin_rl.tasks.nav.observations import NavObservations


class NavEnv(TaskEnv):
    """Navigation in all worlds at once; what a step does is described in `TaskEnv`.

    The observation groups are documented in `observations.py`.
    """

    last_transition: rewards.Transition | None = None

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
        self._scene = scene
        self._layout_params = with_camera_at(cfg.scene, cfg.camera_pose)
        camera_action = None
        if cfg.camera_pose is not None:
            camera_action = torch.tensor(
                [robot.action_of(*pose) for pose in zip(robot.CAMERA_JOINTS, cfg.camera_pose, strict=True)],
                device=device,
            )
        pool = PoolSpec() if scene is None else scene.pool
        profile, moving = robot.SPEED_PROFILES[cfg.robot_profile], (scene or cfg.scene).moves
        sim = Simulation(num_envs, pool, profile, cfg.sim, device, moving=moving)
        if scene is not None:
            sim.layout.load(scene)
        scales = rewards.check_scales(cfg.reward)
        super().__init__(cfg, sim, seed, scales, rewards.TERMS, camera_action)
        with wp.ScopedDevice(device):
            self._allocate(cfg)
        self.scandots = Scandots(
            sim.layout,
            qpos=sim.data.qpos,
            site_xpos=sim.data.site_xpos,
            site_xmat=sim.data.site_xmat,
            camera_site=self.camera_site,
            tan_half_fov=self.tan_half_fov,
            window=cfg.scandots.window_m,
            near=cfg.scandots.near_m,
            occlusion=cfg.scandots.occlusion,
        )
        self.observations = NavObservations(sim, self.scandots, cfg.noise, seed, self.depth)
        self.statistics = NavStatistics(num_envs, tuple(scales), device)
        self._clearance = Clearance(sim, cfg.clearance_m) if "clearance" in scales else None
        self._make_views()
        self._begin(seed, capture)

    def _allocate(self, cfg: NavConfig) -> None:
        n = self.num_envs
        self._scenario_choice = wp.full(n, cfg.scenario, dtype=wp.int32)
        self._difficulty_choice = wp.full(n, cfg.difficulty, dtype=wp.int32)
        self._distance = wp.zeros(n, dtype=float)
        self._progress = wp.zeros(n, dtype=float)
        self._goal_distance = wp.zeros(n, dtype=float)

    def _make_views(self) -> None:
        self._progress_view = wp.to_torch(self._progress)
        self._goal_distance_view = wp.to_torch(self._goal_distance)
        # The goal before the step: layouts of worlds that ended have changed when rewards are computed.
        self._goal_before = torch.zeros_like(self.sim.views.goal)
        self._haste = self._zero if self._clearance is None else wp.to_torch(self._clearance.haste)

    def _launch_step(self) -> None:
        sim, cfg = self.sim, self.cfg
        sim.advance()
        if self._clearance is not None:
            self._clearance.update()
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
                self._moves.up,
                self._moves.down,
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

    def set_cells(self, scenario: torch.Tensor | list[int], difficulty: torch.Tensor | list[int]) -> None:
        """Fix scenario and difficulty of every world, from its next episode on.

        Args:
            scenario: 1 straight, 2 L-shaped, 0 a mix, shape (num_envs,).
            difficulty: 0 easy, 1 medium, 2 hard, -1 a mix, shape (num_envs,).
        """
        for name, values in (("scenario", scenario), ("difficulty", difficulty)):
            view = wp.to_torch(getattr(self, f"_{name}_choice"))
            view.copy_(torch.as_tensor(values, dtype=torch.int32))

    def _before_step(self) -> None:
        self._goal_before.copy_(self.sim.views.goal)

    def _transition(self, action: torch.Tensor) -> rewards.Transition:
        qpos, qvel = self.final_qpos, self.final_qvel
        to_goal = self._goal_before - qpos[:, :2]
        direction = to_goal / to_goal.norm(dim=-1, keepdim=True).clamp_min(1e-6)
        return rewards.Transition(
            progress=self._progress_view,
            goal_distance=self._goal_distance_view,
            goal_speed=(qvel[:, :2] * direction).sum(-1),
            qvel=qvel,
            success=self.outcome == episode.SUCCESS,
            collision=self.sim.views.part_contacts.any(-1),
            self_contact=self.sim.views.self_contact,
            action=action,
            last_action=self._last_action,
            haste=self._haste,
        )
