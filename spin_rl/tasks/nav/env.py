"""The navigation task: drive through clutter to a goal, seeing only what the camera sees (SPIN 2.1.2)."""

from __future__ import annotations

from collections.abc import Sequence

import torch
import warp as wp

from spin_rl import robot
from spin_rl.config import ConfigError
from spin_rl.planning.distance_field import DistanceField, GridSpec
from spin_rl.scenes.corridors.generator import generate_layouts
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.scenes.rooms.generator import FamilyGenerator
from spin_rl.scenes.rooms.params import BLOCKED_M, FamilyParams
from spin_rl.sensors.awareness import Awareness
from spin_rl.sensors.clearance import Clearance
from spin_rl.sensors.gaze import Gaze
from spin_rl.sensors.lidar import Lidar
from spin_rl.sensors.memory import SeenThings
from spin_rl.sensors.noisy_map import NoisyMap
from spin_rl.sensors.odometry import Odometry
from spin_rl.sensors.patrol import Patrol
from spin_rl.sim.graph import torch_order
from spin_rl.tasks.common.corridor import CorridorEnv
from spin_rl.tasks.common.env import with_camera_at
from spin_rl.tasks.common.episode import SUCCESS
from spin_rl.tasks.common.rules import rules_of
from spin_rl.tasks.nav import episode
from spin_rl.tasks.nav.camera import CameraActions
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.guard import Guard
from spin_rl.tasks.nav.observations import NavObservations
from spin_rl.tasks.nav.planner import Planner
from spin_rl.tasks.nav.rewards import TERMS, NavTransition
from spin_rl.tasks.nav.statistics import NavStatistics
from spin_rl.tasks.nav.ways import WayAhead, corridor_ways, field_ways, most_steps


class NavEnv(CorridorEnv):
    """Navigation in all worlds at once; what a step does is described in `TaskEnv`.

    The observation groups are documented in `observations.py`.

    Attributes:
        guard: What keeps the base from driving into what was seen; None if nothing does.
        planner: What gives the policy points of the way for its goal; None if nothing does.
        most_steps: Control steps that the running episode may take, a view, shape (num_envs,), int32.
        lidar: The lidar, where the configuration enables it, else None.
        way_left: Way left to the goal in the running episode [m], a view, shape (num_envs,).
        final_way: Way to the goal at the start of the episode that the last step belongs to [m], a view,
            shape (num_envs,).
        final_driven: Path that the base drove in it up to that step [m], likewise.
    """

    cfg: NavConfig
    last_transition: NavTransition | None = None

    def __init__(
        self,
        cfg: NavConfig,
        num_envs: int,
        device: str = "cpu",
        seed: int = 0,
        *,
        scene: Scene | Sequence[Scene] | None = None,
        capture: bool = True,
    ) -> None:
        """Allocate all worlds, compile kernels and start every episode.

        Args:
            cfg: Task configuration.
            num_envs: Number of worlds.
            device: Warp and Torch device.
            seed: Seed of layouts, start poses, dynamics and sensor noise.
            scene: A fixed scene for every world and episode instead of generated ones; or several for the
                worlds in turn: then ways and time limits are as in scene families, see `set_scenes`.
            capture: False launches kernels eagerly.

        Raises:
            ConfigError: A planner without the guard.
        """
        if cfg.planner.enabled and not cfg.guard.enabled:  # the guard may be the policy's: not known before
            raise ConfigError("task.planner.enabled: the planner needs task.guard.enabled=true")
        fixed = [scene] if isinstance(scene, Scene) else list(scene or ())
        super().__init__(
            cfg,
            num_envs,
            device,
            seed,
            pool=_pool(cfg, fixed),
            terms=TERMS,
            camera_action=[
                robot.action_of(joint, at)
                for joint, at in zip(robot.CAMERA_JOINTS, cfg.camera_pose or (), strict=False)
            ],
            moving=any(given.moves for given in fixed or (cfg.scene,)),
        )
        self._camera = CameraActions(cfg, device) if cfg.camera_pose is None else None
        self._is_fixed = bool(fixed)
        self._layout_params = with_camera_at(cfg.scene, cfg.camera_pose)
        with wp.ScopedDevice(device):
            self._distance = wp.zeros(num_envs, dtype=float)
            self._progress = wp.zeros(num_envs, dtype=float)
            self._goal_distance = wp.zeros(num_envs, dtype=float)
            self._family_choice = wp.full(num_envs, -1, dtype=wp.int32)
        self._trips = episode.make_trips(num_envs, device)
        self._make_ways(cfg, scene)
        self._rules = rules_of(episode.NavRules, cfg, level_up=self._moves.up, level_down=self._moves.down)
        self._make_corridors(cfg)
        needs_clearance = "clearance" in self._reward_scales
        self._clearance = Clearance(self.sim, cfg.clearance_m) if needs_clearance else None
        ahead = WayAhead(self._ways, self.sim.data.qpos, self._goal)
        noisy_map = self._make_map(cfg)
        seen = self._make_memory(cfg)
        observations = NavObservations(
            self.sim,
            self.goal if self.planner is None else self.planner.subgoal,
            self.scandots,
            cfg.noise,
            seed,
            self.depth,
            cfg.goal_range_m,
            ahead,
            noisy_map,
        )
        self._make_lidar(cfg, observations)
        self.observations = observations
        if self._gaze is not None and cfg.teach_gaze:
            observations.add(gaze=self._gaze.gaze)
        if self._gaze is not None and self._camera is not None:
            self._camera.follow(wp.to_torch(self._gaze.gaze))
        self.statistics = NavStatistics(num_envs, tuple(self._reward_scales), device)
        self._make_views()
        self._begin(
            seed,
            capture,
            sensors=(
                *(self.scandots, seen, self.planner, noisy_map),
                *(ahead, self.depth, self.lidar, self._odometry, self._gaze),
            ),
            step_sensors=(self._clearance, self._awareness),
        )

    def _make_ways(self, cfg: NavConfig, scene: Scene | Sequence[Scene] | None) -> None:
        """Make what says how far the goal is: a distance field, or corridors' shape."""
        layout = self.sim.layout
        self._field = None
        self._families = None
        if scene is None and isinstance(self._layout_params, FamilyParams):
            self._families = FamilyGenerator(layout, self._layout_params)
        if isinstance(scene, Scene):
            layout.load(scene)
        if isinstance(scene, Scene) or (scene is None and not isinstance(cfg.scene, FamilyParams)):
            self._ways = corridor_ways(layout, self.max_episode_length)
            return
        grid = GridSpec() if scene is None else GridSpec.around(scene)
        # A fixed scene's ways are no longer than twice around it.
        longest = cfg.scene.way[1] if isinstance(cfg.scene, FamilyParams) else 0.0
        longest = longest if scene is None else 4.0 * (grid.nx + grid.ny) * grid.cell_m
        blocked = BLOCKED_M if scene is None else None
        self._field = DistanceField(layout, self.device, grid, blocked_m=blocked)
        self._ways = field_ways(
            layout,
            self._field,
            robot.SPEED_PROFILES[cfg.robot_profile],
            longest_m=longest,
            period=cfg.sim.control_period,
            slack_s=cfg.slack_s,
            slowness=cfg.slowness,
        )
        self.max_episode_length = most_steps(self._ways, cfg.dynamics.speed_scale[0])
        if scene is not None:
            self.set_scenes([scene[world % len(scene)] for world in range(self.num_envs)])

    def _make_lidar(self, cfg: NavConfig, observations: NavObservations) -> None:
        self.lidar = self._odometry = None
        if cfg.lidar.enabled:
            drawn = {"seed": self._seed, "episode": self._counter}
            self.lidar = Lidar(self.sim, cfg.lidar, **drawn)
            self._odometry = Odometry(self.sim.data.qpos, cfg.odometry, **drawn)
            observations.add(lidar=self.lidar.ranges, odometry=self._odometry.pose)

    def _make_memory(self, cfg: NavConfig) -> SeenThings | None:
        """Make what goes by what the camera has shown, and return what remembers that."""
        self.guard: Guard | None = None
        self.planner: Planner | None = None
        self._awareness: Awareness | None = None
        self._gaze: Gaze | Patrol | None = None
        is_rewarded = "information" in self._reward_scales
        is_gazed = cfg.teach_gaze or cfg.camera_action == "gaze"
        if not (cfg.guard.enabled or is_rewarded or is_gazed):
            return None
        sim, period = self.sim, cfg.sim.control_period
        max_age = round(cfg.guard.memory_s / period)
        tokens = (sim.layout, sim.layout.nearby, sim.data.qpos, self.scandots)
        seen = SeenThings(*tokens, self._episode_length, max_age)
        if cfg.guard.enabled:
            self.guard = Guard(sim, seen, cfg.guard, robot.SPEED_PROFILES[cfg.robot_profile])
            if cfg.planner.enabled:
                self.planner = Planner(seen, sim.data.qpos, self._goal, cfg.planner, period)
                self.guard.add_recovery(self.planner.field, cfg.planner.stuck_s, self._episode_length)
        if is_rewarded:
            self._awareness = Awareness(sim.layout, sim.data.qpos, seen, cfg.information_m, period)
        if is_gazed and cfg.gaze_poses:
            self._gaze = Patrol(cfg.gaze_poses, sim.data.qpos, sim.action)
        elif is_gazed:
            ahead = self._goal if self.planner is None else wp.from_torch(self.planner.subgoal, dtype=wp.vec2)
            moves = (sim.data.qpos, sim.data.qvel, ahead)
            self._gaze = Gaze(
                sim.layout, *moves, seen, near_m=cfg.information_m, mount=cfg.camera_mount, period=period
            )
        return seen

    def _set_camera(self, action: torch.Tensor) -> None:
        super()._set_camera(action)
        if self._camera is not None:
            before = self._last_action[:, -len(robot.CAMERA_JOINTS) :]
            self._camera.apply(action, before, self.episode_length_buf)

    def _before_advance(self) -> None:
        if self.guard is not None:
            self.guard.apply()

    def _make_map(self, cfg: NavConfig) -> NoisyMap | None:
        if not cfg.map.enabled:
            return None
        return self._noisy_map(cfg, way=self._trips.way, way_left=self._distance)

    def _make_views(self) -> None:
        self._progress_view = wp.to_torch(self._progress)
        self._goal_distance_view = wp.to_torch(self._goal_distance)
        self.most_steps = wp.to_torch(self._ways.most_steps)
        self.way_left = wp.to_torch(self._distance)
        self.final_way = wp.to_torch(self._trips.final_way)
        self.final_driven = wp.to_torch(self._trips.final_driven)
        # The goal before the step: worlds that ended have new ones when rewards are computed.
        self._goal_before = torch.zeros_like(self.goal)
        self._haste = self._zero if self._clearance is None else wp.to_torch(self._clearance.haste)
        self._information = self._zero if self._awareness is None else wp.to_torch(self._awareness.gain)

    def _end_episodes(self) -> None:
        sim = self.sim
        wp.launch(
            episode.end_episodes,
            dim=self.num_envs,
            inputs=[
                sim.data.qpos,
                sim.data.qvel,
                sim.action,
                sim.layout.goal,
                sim.contacts.parts,
                self._rules,
                self._ways,
                self._episode_length,
                self._goal,
                self._distance,
                self._level,
                self._trips,
            ],
            outputs=[self._progress, self._goal_distance, self._end],
        )

    def _draw_scenes(self, mask: wp.array) -> None:
        layout, params = self.sim.layout, self._layout_params
        draw = {"seed": self._seed, "counter": self._layout_counter, "mask": mask}
        if self._is_fixed:
            return
        if self._field is not None:
            assert self._families is not None
            self._families.build(**draw, family_choice=self._family_choice)
            self._field.update(layout.goal, mask)
            self._families.place_starts(self._field.field, **draw)
        else:
            generate_layouts(
                layout,
                params,
                **draw,
                scenario_choice=self._scenario_choice,
                difficulty_choice=self._difficulty_choice,
                level=self._level,
            )

    def _begin_episodes(self, mask: wp.array) -> None:
        super()._begin_episodes(mask)
        sim = self.sim
        wp.launch(
            episode.begin_episodes,
            dim=self.num_envs,
            inputs=[mask, sim.data.qpos, self._goal, sim.layout.goal, sim.dynamics.speed_scale],
            outputs=[self._ways, self._trips, self._distance],
        )

    def set_families(self, families: torch.Tensor | list[int]) -> None:
        """Fix the family of every world, from its next episode on.

        Args:
            families: Index of `kinds.FAMILIES`, -1 by shares, shape (num_envs,).
        """
        wp.to_torch(self._family_choice).copy_(torch.as_tensor(families, dtype=torch.int32))

    def set_scenes(self, scenes: Sequence[Scene]) -> None:
        """Put a scene into every world of an environment that was made with several, from a reset on.

        Args:
            scenes: One for each world, with no more slots and no larger than those that it was made with.
        """
        assert self._field is not None
        self.sim.layout.load_each(scenes)
        with torch_order(self.device):
            self._field.update(self.sim.layout.goal, self._all)

    def _before_step(self) -> None:
        self._goal_before.copy_(self.goal)

    def _transition(self, action: torch.Tensor) -> NavTransition:
        qpos, qvel = self.final_qpos, self.final_qvel
        to_goal = self._goal_before - qpos[:, :2]
        direction = to_goal / to_goal.norm(dim=-1, keepdim=True).clamp_min(1e-6)
        return NavTransition(
            progress=self._progress_view,
            goal_distance=self._goal_distance_view,
            goal_speed=(qvel[:, :2] * direction).sum(-1),
            qvel=qvel,
            success=self.outcome == SUCCESS,
            collision=self.sim.views.part_contacts.any(-1),
            self_contact=self.sim.views.self_contact,
            action=action,
            last_action=self._last_action,
            observations=self._observed,
            haste=self._haste,
            information=self._information,
        )


def _pool(cfg: NavConfig, fixed: Sequence[Scene]) -> PoolSpec:
    """Scene geoms that fixed scenes need, or generated ones if there are none."""
    if fixed:
        counts = ("num_walls", "num_boxes", "num_cylinders")
        return PoolSpec(**{name: max(getattr(scene.pool, name) for scene in fixed) for name in counts})
    return cfg.scene.pool if isinstance(cfg.scene, FamilyParams) else PoolSpec()
