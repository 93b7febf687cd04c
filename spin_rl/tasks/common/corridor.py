# pyright: reportInvalidTypeForm=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""What tasks in corridors share: the choice of corridors, the goals, and the sensor of obstacles."""

import torch
import warp as wp

from spin_rl import robot
from spin_rl.sensors.noisy_map import NoisyMap
from spin_rl.sensors.scandots import Scandots
from spin_rl.tasks.common.config import CorridorConfig
from spin_rl.tasks.common.env import TaskEnv

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _take_goals(
    # In
    mask: wp.array(dtype=bool),
    layout_goal: wp.array(dtype=wp.vec2),
    has_via: wp.array(dtype=bool),
    via: wp.array(dtype=wp.vec2),
    # Out
    goal_out: wp.array(dtype=wp.vec2),
) -> None:
    w = wp.tid()
    if mask[w]:
        goal_out[w] = layout_goal[w]
        if has_via[w]:
            goal_out[w] = via[w]


class CorridorEnv(TaskEnv):
    """A task in corridors; generators of scenes read `_scenario_choice` and `_difficulty_choice`.

    Attributes:
        goal: Where the base should go [m], at first the layout's, or its place before that, a view, shape
            (num_envs, 2).
        scandots: The scandot sensor.
    """

    scandots: Scandots

    def _make_corridors(self, cfg: CorridorConfig) -> None:
        """Allocate the choice of every world's next corridor, the goals and the sensor."""
        sim = self.sim
        with wp.ScopedDevice(self.device):
            self._scenario_choice = wp.full(self.num_envs, cfg.scenario, dtype=wp.int32)
            self._difficulty_choice = wp.full(self.num_envs, cfg.difficulty, dtype=wp.int32)
            self._goal = wp.zeros(self.num_envs, dtype=wp.vec2)
        self.goal = wp.to_torch(self._goal)
        self.scandots = Scandots(
            sim.layout,
            qpos=sim.data.qpos,
            site_xpos=sim.data.site_xpos,
            site_xmat=sim.data.site_xmat,
            camera_site=sim.mj_model.site(robot.CAMERA_SITE).id,
            tan_half_fov=robot.camera_tan_half_fov(cfg.camera_mount),
            window=cfg.scandots.window_m,
            near=cfg.scandots.near_m,
            occlusion=cfg.scandots.occlusion,
            pieces_from=cfg.scandots.pieces_from_m,
        )

    def _noisy_map(self, cfg: CorridorConfig, *, way: wp.array, way_left: wp.array) -> NoisyMap:
        """Make a map of what the sensor would see, with errors that change in the middle of a way."""
        return NoisyMap(
            self.scandots.all,
            cfg.map.errors,
            seed=self._seed,
            episode=self._counter,
            step=self._episode_length,
            level=self._level,
            way=way,
            way_left=way_left,
            qpos=self.sim.data.qpos,
        )

    def _begin_episodes(self, mask: wp.array) -> None:
        """Also take over the goals of the masked worlds' new layouts."""
        super()._begin_episodes(mask)
        layout = self.sim.layout
        wp.launch(
            _take_goals,
            dim=self.num_envs,
            inputs=[mask, layout.goal, layout.has_via, layout.via],
            outputs=[self._goal],
        )

    def set_cells(self, scenario: torch.Tensor | list[int], difficulty: torch.Tensor | list[int]) -> None:
        """Fix scenario and difficulty of every world, from its next episode on.

        Args:
            scenario: 1 straight, 2 L-shaped, 0 a mix, shape (num_envs,).
            difficulty: 0 easy, 1 medium, 2 hard, -1 a mix, shape (num_envs,).
        """
        for choice, values in ((self._scenario_choice, scenario), (self._difficulty_choice, difficulty)):
            wp.to_torch(choice).copy_(torch.as_tensor(values, dtype=torch.int32))
