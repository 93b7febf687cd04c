"""The pick task: find the object on a table with the camera, grasp it and hold it up (SPIN 2.1.1)."""

from __future__ import annotations

import torch
import warp as wp

from spin_rl import robot
from spin_rl.scenes.layout import PoolSpec
from spin_rl.scenes.tabletops.generator import generate_tabletops
from spin_rl.tasks.common.env import TaskEnv, with_camera_at
from spin_rl.tasks.common.objects.choice import ObjectChoice
from spin_rl.tasks.common.objects.sight import Sight
from spin_rl.tasks.common.rules import rules_of
from spin_rl.tasks.pick import episode as pick_episode
from spin_rl.tasks.pick import rewards as pick_rewards
from spin_rl.tasks.pick.config import PickConfig
from spin_rl.tasks.pick.observations import PickObservations
from spin_rl.tasks.pick.rewards import PickTransition
from spin_rl.tasks.pick.statistics import PickStatistics


class PickEnv(ObjectChoice, TaskEnv):
    """Picking in all worlds at once; what a step does is described in `TaskEnv`.

    The observation groups are documented in `observations.py`, the actions in `sim/targets.py`. An
    episode with a success at any time has the outcome success, however it ends.
    """

    cfg: PickConfig
    statistics: PickStatistics
    outcomes = pick_episode.PICK_OUTCOMES
    last_transition: PickTransition | None = None

    def __init__(
        self,
        cfg: PickConfig,
        num_envs: int,
        device: str = "cpu",
        seed: int = 0,
        *,
        capture: bool = True,
    ) -> None:
        """Allocate all worlds, compile kernels and start every episode.

        Args:
            cfg: Task configuration.
            num_envs: Number of worlds.
            device: Warp and Torch device.
            seed: Seed of tables, objects, start poses, dynamics and sensor noise.
            capture: False launches kernels eagerly.
        """
        super().__init__(
            cfg,
            num_envs,
            device,
            seed,
            pool=PoolSpec(),
            terms=pick_rewards.TERMS,
            camera_action=[0.0] * len(robot.CAMERA_JOINTS),
            manipulation=cfg.manipulation,
        )
        sim = self.sim
        self._scene_params = with_camera_at(cfg.scene, cfg.camera_pose)
        with wp.ScopedDevice(device):
            self._allocate(cfg)
        self.sight = Sight(sim, cfg.detector, cfg.sight, camera_mount=cfg.camera_mount, images=self.depth)
        self.observations = PickObservations(
            sim,
            cfg.noise,
            seed,
            seen=wp.to_torch(self.sight.seen),
            at=wp.to_torch(self.sight.at),
            length=self.episode_length_buf,
            held=wp.to_torch(self._progress.held),
            max_length=self.max_episode_length,
            hold_steps=self._rules.hold_steps,
            depth=self.depth,
        )
        self.statistics = PickStatistics(
            num_envs,
            tuple(self._reward_scales),
            device,
            kind=sim.object.views.kind,
            near=sim.object.views.near,
            seen=wp.to_torch(self.sight.seen),
        )
        self._begin(seed, capture, sensors=(self.sight, self.depth))

    def _allocate(self, cfg: PickConfig) -> None:
        n, sim = self.num_envs, self.sim
        self._allocate_choice(n, cfg.object)
        self._near_share = wp.zeros(n, dtype=float)
        self._step_arrays, self._step_views = pick_episode.make_step_arrays(n, self.device)
        self._progress = pick_episode.Progress()
        self._progress.length = self._episode_length
        self._progress.held = wp.zeros(n, dtype=wp.int32)
        self._progress.succeeded = wp.zeros(n, dtype=bool)
        self._progress.hard_peak = wp.zeros(n, dtype=float)
        self._progress.level = self._level
        self._forces = pick_episode.read_forces(sim.grasp)
        self._rules = rules_of(
            pick_episode.PickRules, cfg, level_up=self._moves.up, level_down=self._moves.down
        )

    def _end_episodes(self) -> None:
        sim = self.sim
        # Poses of the gripper are those of the last substep's start until now.
        sim.forward()
        wp.launch(
            pick_episode.end_picks,
            dim=self.num_envs,
            inputs=[
                sim.data.qpos,
                sim.data.qvel,
                sim.action,
                sim.data.site_xpos,
                sim.data.site_xmat,
                sim.mj_model.site(robot.GRASP_CENTER_SITE).id,
                sim.object.start_pose,
                sim.object.half_extents,
                self._forces,
                self._rules,
                self._progress,
            ],
            outputs=[self._step_arrays, self._end],
        )

    def _draw_scenes(self, mask: wp.array) -> None:
        sim, cfg = self.sim, self.cfg
        wp.launch(
            pick_episode.set_near_share,
            dim=self.num_envs,
            inputs=[self._level, cfg.curriculum.start, *cfg.near_share],
            outputs=[self._near_share],
        )
        generate_tabletops(
            sim.layout,
            sim.object.start,
            self._scene_params,
            seed=self._seed,
            counter=self._layout_counter,
            mask=mask,
            level=self._level,
            near_share=self._near_share,
            kind_choice=self._kind_choice,
        )

    def _begin_episodes(self, mask: wp.array) -> None:
        super()._begin_episodes(mask)
        wp.launch(
            pick_episode.begin_picks,
            dim=self.num_envs,
            inputs=[mask],
            outputs=[self._progress, self._forces],
        )

    def _before_step(self) -> None:
        self.statistics.before_step()

    def _transition(self, action: torch.Tensor) -> PickTransition:
        step = self._step_views
        return PickTransition(
            qvel=self.final_qvel,
            success=step.success,
            collision=step.collision,
            action=action,
            last_action=self._last_action,
            observations=self._observed,
            distance=step.distance,
            height=step.height,
            finger=step.finger,
            finger_force=step.finger_force,
            table_force=step.table_force,
            hard_peak=step.hard_peak,
            inside=step.inside,
            grasped=step.grasped,
            pressed=step.pressed,
            dropped=step.dropped,
        )

    def _time_outs(self) -> torch.Tensor:
        return self._step_views.time_out.clone()
