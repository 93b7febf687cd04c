"""What tasks in corridors share: which corridor every world gets, and what is seen of its obstacles."""

from __future__ import annotations

import torch
import warp as wp

from spin_rl import robot
from spin_rl.sensors.scandots import Scandots
from spin_rl.tasks.common.config import ScandotsConfig
from spin_rl.tasks.common.env import TaskEnv


class CorridorEnv(TaskEnv):
    """A task in corridors; generators of scenes read `_scenario_choice` and `_difficulty_choice`.

    Attributes:
        scandots: The scandot sensor.
    """

    scandots: Scandots

    def _make_corridors(self, scenario: int, difficulty: int, scandots: ScandotsConfig) -> None:
        """Allocate the choice of every world's next corridor, and the sensor."""
        sim = self.sim
        with wp.ScopedDevice(self.device):
            self._scenario_choice = wp.full(self.num_envs, scenario, dtype=wp.int32)
            self._difficulty_choice = wp.full(self.num_envs, difficulty, dtype=wp.int32)
        self.scandots = Scandots(
            sim.layout,
            qpos=sim.data.qpos,
            site_xpos=sim.data.site_xpos,
            site_xmat=sim.data.site_xmat,
            camera_site=sim.mj_model.site(robot.CAMERA_SITE).id,
            tan_half_fov=robot.camera_tan_half_fov(self.cfg.camera_mount),
            window=scandots.window_m,
            near=scandots.near_m,
            occlusion=scandots.occlusion,
        )

    def set_cells(self, scenario: torch.Tensor | list[int], difficulty: torch.Tensor | list[int]) -> None:
        """Fix scenario and difficulty of every world, from its next episode on.

        Args:
            scenario: 1 straight, 2 L-shaped, 0 a mix, shape (num_envs,).
            difficulty: 0 easy, 1 medium, 2 hard, -1 a mix, shape (num_envs,).
        """
        for choice, values in ((self._scenario_choice, scenario), (self._difficulty_choice, difficulty)):
            wp.to_torch(choice).copy_(torch.as_tensor(values, dtype=torch.int32))
