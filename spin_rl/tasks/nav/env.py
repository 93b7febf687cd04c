"""The navigation task: drive through clutter to a goal, seeing only what the camera sees (SPIN 2.1.2)."""

from __future__ import annotations

import torch
import warp as wp

from spin_rl import robot
from spin_rl.scenes.corridors.generator import generate_layouts
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.sensors.clearance import Clearance
from spin_rl.tasks.common import episode, rewards
from spin_rl.tasks.common.config import NavConfig
from spin_rl.tasks.common.corridor import CorridorEnv
from spin_rl.tasks.common.env import with_camera_at
from spin_rl.tasks.common.statistics import NavStatistics
from spin_rl.tasks.nav.observations import NavObservations


class NavEnv(CorridorEnv):
    """Navigation in all worlds at once; what a step does is described in `TaskEnv`.

    The observation groups are documented in `observations.py`.
    """

    cfg: NavConfig
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
        super().__init__(
            cfg,
            num_envs,
            device,
            seed,
            pool=PoolSpec() if scene is None else scene.pool,
            terms=rewards.TERMS,
            camera_action=[
                robot.action_of(joint, at)
                for joint, at in zip(robot.CAMERA_JOINTS, cfg.camera_pose or (), strict=False)
            ],
            moving=(scene or cfg.scene).moves,
        )
        self._scene = scene
        self._layout_params = with_camera_at(cfg.scene, cfg.camera_pose)
        if scene is not None:
            self.sim.layout.load(scene)
        with wp.ScopedDevice(device):
            self._distance = wp.zeros(num_envs, dtype=float)
            self._progress = wp.zeros(num_envs, dtype=float)
            self._goal_distance = wp.zeros(num_envs, dtype=float)
        self._make_corridors(cfg.scenario, cfg.difficulty, cfg.scandots)
        needs_clearance = "clearance" in self._reward_scales
        self._clearance = Clearance(self.sim, cfg.clearance_m) if needs_clearance else None
        self.observations = NavObservations(self.sim, self.scandots, cfg.noise, seed, self.depth)
        self.statistics = NavStatistics(num_envs, tuple(self._reward_scales), device)
        self._make_views()
        self._begin(seed, capture, sensors=(self.scandots, self.depth), step_sensors=(self._clearance,))

    def _make_views(self) -> None:
        self._progress_view = wp.to_torch(self._progress)
        self._goal_distance_view = wp.to_torch(self._goal_distance)
        # The goal before the step: layouts of worlds that ended have changed when rewards are computed.
        self._goal_before = torch.zeros_like(self.sim.views.goal)
        self._haste = self._zero if self._clearance is None else wp.to_torch(self._clearance.haste)

    def _end_episodes(self) -> None:
        sim, cfg = self.sim, self.cfg
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

    def _draw_scenes(self, mask: wp.array) -> None:
        if self._scene is None:
            generate_layouts(
                self.sim.layout,
                self._layout_params,
                seed=self._seed,
                counter=self._layout_counter,
                mask=mask,
                scenario_choice=self._scenario_choice,
                difficulty_choice=self._difficulty_choice,
                level=self._level,
            )

    def _begin_episodes(self, mask: wp.array) -> None:
        sim = self.sim
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
