# pyright: reportGeneralTypeIssues=false
# (to a type checker, a Warp struct is an object, not a class)
"""The fetch task: drive to a table through clutter, pick, carry back, put down (SPIN, Table 1)."""

from __future__ import annotations

from dataclasses import replace

import torch
import warp as wp
from tensordict import TensorDict

from spin_rl import robot
from spin_rl.scenes.corridor_tables.generator import generate_fetch_scenes
from spin_rl.sensors.noisy_map import NoisyMap
from spin_rl.sim.drive import DriveLimits
from spin_rl.sim.simulation import Simulation
from spin_rl.tasks.common import episode
from spin_rl.tasks.common.corridor import CorridorEnv
from spin_rl.tasks.common.env import with_camera_at
from spin_rl.tasks.common.objects.choice import ObjectChoice
from spin_rl.tasks.common.objects.sight import Sight
from spin_rl.tasks.common.rules import rules_of
from spin_rl.tasks.fetch import stages as fetch_stages
from spin_rl.tasks.fetch import start as fetch_start
from spin_rl.tasks.fetch import state as fetch_state
from spin_rl.tasks.fetch.config import FetchConfig
from spin_rl.tasks.fetch.known import Knowledge
from spin_rl.tasks.fetch.observations import FetchObservations
from spin_rl.tasks.fetch.results import FetchEpisodes, FetchStatistics, FetchStep, read_record
from spin_rl.tasks.fetch.scripts import kernel as fetch_script
from spin_rl.tasks.nav.observations import NavObservations
from spin_rl.tasks.pick.config import PickNoise
from spin_rl.tasks.pick.episode import read_forces
from spin_rl.tasks.pick.observations import PickObservations
from spin_rl.warp_kernels.slots import slots_of
from spin_rl.warp_kernels.structs import struct_of


class FetchEnv(ObjectChoice, CorridorEnv):
    """Whole fetches in all worlds at once; what a step does is described in `TaskEnv`.

    Actions count in the stages `reach`, `pick` and `carry` (see `state.py`), in `carry` those of base,
    head and `cfg.carry_moves` alone; scripts replace all others. `FetchPolicy` makes them of two policies.

    Attributes:
        stage: Stage of every world, index into `state.STAGES`, a view, shape (num_envs,), int32.
    """

    cfg: FetchConfig
    outcomes = fetch_state.FETCH_OUTCOMES
    stages = fetch_state.STAGES
    last_transition: FetchStep | None = None

    def __init__(
        self,
        cfg: FetchConfig,
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
            seed: Seed of corridors, tables, objects, start poses, dynamics and sensor noise.
            capture: False launches kernels eagerly.
        """
        super().__init__(
            cfg,
            num_envs,
            device,
            seed,
            pool=cfg.scene.pool,
            terms={},
            camera_action=(),
            manipulation=cfg.manipulation,
        )
        self._scene_params = cfg.scene
        self._held: wp.vec2 | None = None
        if cfg.camera_pose is not None:
            corridor = with_camera_at(cfg.scene.corridor, cfg.camera_pose)
            self._scene_params = replace(cfg.scene, corridor=corridor)
            self._held = wp.vec2(*map(robot.action_of, robot.CAMERA_JOINTS, cfg.camera_pose))
        self._make_corridors(cfg)
        with wp.ScopedDevice(device):
            self._allocate(cfg)
        self.sight = Sight(
            self.sim, cfg.detector, cfg.sight, camera_mount=cfg.camera_mount, images=self.depth
        )
        self.stage = wp.to_torch(self._state.stage)
        self._reached, self._picked = wp.to_torch(self._state.reached), wp.to_torch(self._state.picked)
        self._recorded = wp.to_torch(self._record.outcome)
        noisy_map = self._make_map(cfg)
        self.observations = self._make_observations(cfg, seed, noisy_map)
        self.statistics = FetchStatistics(num_envs, device)
        self._begin(seed, capture, sensors=(self.scandots, noisy_map, self.sight, self.depth))

    def _make_map(self, cfg: FetchConfig) -> NoisyMap | None:
        """Make what a policy with a map drives by; its kind of errors is drawn once, for the whole fetch."""
        if not cfg.map.enabled:
            return None
        everywhere = wp.ones(self.num_envs, dtype=float, device=self.device)
        return self._noisy_map(cfg, way=everywhere, way_left=everywhere)

    def _make_observations(
        self, cfg: FetchConfig, seed: int, noisy_map: NoisyMap | None
    ) -> FetchObservations:
        sim = self.sim
        pick = PickObservations(
            sim,
            PickNoise(object_m=cfg.noise.object_m),
            seed + 1,
            seen=wp.to_torch(self.sight.seen),
            at=wp.to_torch(self.sight.at),
            length=wp.to_torch(self._state.time),
            held=wp.to_torch(self._state.held),
            max_length=round(cfg.limits.pick / cfg.sim.control_period),
            hold_steps=self._rules.hold_steps,
        )
        given = (cfg.noise, seed, self.depth, cfg.goal_range_m)
        nav = NavObservations(sim, self.goal, self.scandots, *given, noisy_map=noisy_map)
        told = None
        if not cfg.tell_table:
            slots = [slot for slot in range(cfg.scene.pool.num_slots) if slot != cfg.scene.table_slot]
            told = torch.tensor(slots, device=self.device)
        return FetchObservations(nav, pick, self.stage, self.depth, cfg.pick_range_m, told)

    def _allocate(self, cfg: FetchConfig) -> None:
        n, sim, period = self.num_envs, self.sim, cfg.sim.control_period
        self._allocate_choice(n, cfg.object)
        self._forces = read_forces(sim.grasp)
        self._state = fetch_state.make_state(n, self.device)
        self._state.length = self._episode_length
        self._record = fetch_state.make_record(n, self.device)
        limits = [round(limit / period) for limit in cfg.limits.seconds()]
        self._rules = rules_of(
            fetch_state.FetchRules,
            cfg,
            limits=wp.array(limits, dtype=wp.int32),
            table_slot=cfg.scene.table_slot,
            must_see=self._held is None and cfg.head_sweeps,
        )
        self._bodies = _bodies(sim, self._goal)
        increments = cfg.manipulation.increments
        self._drive = struct_of(
            fetch_script.Drive,
            DriveLimits.create(robot.SPEED_PROFILES[cfg.robot_profile], self.device),
            carry_moves=wp.array([joint in cfg.carry_moves for joint in robot.JOINTS], dtype=wp.bool),
            carry_lift_m=cfg.carry_lift_m,
            pick_speed=(increments.forward_speed, increments.turn_speed),
            turns_to_look=self._held is not None or not cfg.head_sweeps,
            period=period,
        )
        self._knowledge = Knowledge(sim, self._forces, cfg.scene.table_slot)

    def _launch_step(self) -> None:
        self._knowledge.update()
        wp.launch(
            fetch_script.script_actions,
            dim=self.num_envs,
            inputs=[self._drive, self._knowledge.known],
            outputs=[self._state, self.sim.action],
        )
        if self._held is not None:
            wp.launch(
                fetch_script.hold_camera,
                dim=self.num_envs,
                inputs=[self.sim.mode, self._held],
                outputs=[self.sim.action],
            )
        super()._launch_step()

    def _set_camera(self, action: torch.Tensor) -> None:
        """Leave the camera's actions to the step: scripts replace them too."""

    def _end_episodes(self) -> None:
        sim = self.sim
        # Poses are those of the last substep's start until now.
        sim.forward()
        # The object is seen as it was when the action was chosen.
        wp.launch(
            fetch_stages.advance_stages,
            dim=self.num_envs,
            inputs=[self._bodies, self._forces, self._rules, sim.increments, self.sight.seen],
            outputs=[
                self._state,
                self._record,
                sim.mode,
                sim.action,
                self._end,
            ],
        )

    def _draw_scenes(self, mask: wp.array) -> None:
        sim = self.sim
        generate_fetch_scenes(
            sim.layout,
            sim.object.start,
            self._scene_params,
            seed=self._seed,
            counter=self._layout_counter,
            mask=mask,
            scenario_choice=self._scenario_choice,
            difficulty_choice=self._difficulty_choice,
            level=self._level,
            kind_choice=self._kind_choice,
        )
        wp.launch(fetch_start.prepare_fetches, dim=self.num_envs, inputs=[mask], outputs=[sim.mode])

    def _begin_episodes(self, mask: wp.array) -> None:
        super()._begin_episodes(mask)
        wp.launch(
            fetch_start.begin_fetches,
            dim=self.num_envs,
            inputs=[mask, self.sim.layout.start],
            outputs=[self._state, self._forces],
        )

    def _launch_reset(self, mask: wp.array) -> None:
        super()._launch_reset(mask)
        wp.launch(
            fetch_start.watch_objects,
            dim=self.num_envs,
            inputs=[self.sight.seen, self.sight.at],
            outputs=[self._state],
        )

    def reset(self) -> TensorDict:
        """Start a new fetch in every world, forget the results, and return the first observations."""
        self._recorded.zero_()
        return super().reset()

    def depth_ranges(self) -> torch.Tensor:
        """Return the depths that every world's image shows as nearest and farthest [m], (num_envs, 2).

        Images are those of the policy whose turn it is.
        """
        ranges = super().depth_ranges()
        if self.cfg.pick_range_m is not None:
            ranges[self.stage == self.stages.index("pick")] = ranges.new_tensor(self.cfg.pick_range_m)
        return ranges

    def results(self) -> FetchEpisodes:
        """Copy to the host how the first fetch of every world after `reset` ended; waits for the device."""
        return read_record(self._record)

    def _transition(self, action: torch.Tensor) -> FetchStep:
        return FetchStep(
            qvel=self.final_qvel,
            success=self.outcome == episode.SUCCESS,
            collision=self.outcome == episode.COLLISION,
            action=action,
            last_action=self._last_action,
            observations=self._observed,
            reached=self._reached,
            picked=self._picked,
        )


def _bodies(sim: Simulation, goal: wp.array) -> fetch_state.Bodies:
    bodies = fetch_state.Bodies()
    bodies.qpos, bodies.qvel = sim.data.qpos, sim.data.qvel
    bodies.parts = sim.contacts.parts
    bodies.target = sim.target
    bodies.object_kind = sim.object.kind
    bodies.object_start = sim.object.start_pose
    bodies.half_extents = sim.object.half_extents
    bodies.goal = goal
    bodies.slots = slots_of(sim.layout)
    return bodies
