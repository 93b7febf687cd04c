"""Running a policy to look at it: every step of every world as plain NumPy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch

from spin_rl import robot
from spin_rl.policy import Policy
from spin_rl.scenes.objects.shapes import SceneObject
from spin_rl.tasks.common.env import TaskEnv
from spin_rl.viewer.snapshot import Scandots, Snapshot, Target

_ROBOT = slice(len(robot.DOF_NAMES))
_OBJECT = slice(_ROBOT.stop, None)


class Player:
    """An environment and a policy in it, one control step after the other.

    Attributes:
        env: The environment.
        title: What plays.
        ended: Last snapshots of all finished episodes since `start`, in the order of their end.
    """

    def __init__(self, env: TaskEnv, policy: Policy, title: str = "") -> None:
        """Take over an environment; `start` begins the first episodes.

        Args:
            env: Environment with any number of worlds.
            policy: Policy for it.
            title: What plays, such as the policy's name.
        """
        self.env = env
        self.title = title
        self.ended: list[Snapshot] = []
        self._policy = policy
        self._snapshots: list[Snapshot] = []
        # What only some tasks have.
        self._set_cells, self._goal, self._scandots, self._sight, self._stage = (
            getattr(env, name, None) for name in ("set_cells", "goal", "scandots", "sight", "stage")
        )

    @property
    def snapshots(self) -> list[Snapshot]:
        """Where every world is now; a world whose episode has ended is already at the start of its next."""
        return self._snapshots

    def start(
        self, scenario: int, difficulty: int, *, seed: int | None = None, policy: Policy | None = None
    ) -> list[Snapshot]:
        """Begin new episodes in all worlds.

        Args:
            scenario: 1 straight, 2 L-shaped, 0 a mix; of no meaning where the task has no corridors.
            difficulty: 0 easy, 1 medium, 2 hard, -1 a mix; likewise.
            seed: Starts the sequence of episodes of this seed; None goes on with the running sequence.
            policy: Another policy for the same environment; None keeps the present one.

        Returns:
            A snapshot of every world.
        """
        n = self.env.num_envs
        self._policy = policy or self._policy
        if self._set_cells is not None:
            self._set_cells([scenario] * n, [difficulty] * n)
        if seed is not None:
            self.env.reseed(seed)
        self._obs = self.env.reset()
        self._policy.reset()
        self.ended = []
        self._steps = np.zeros(n, dtype=int)
        self._episodes = np.zeros(n, dtype=int)
        self._scenes = self.env.sim.layout.scenes()
        self._objects = [self._read_object(world) for world in range(n)]
        self._snapshots = self._read()
        return self._snapshots

    @torch.no_grad()
    def step(self) -> list[Snapshot]:
        """Let the policy act once in every world.

        Returns:
            A snapshot of every world. Where an episode has ended, it is the state that ended it, with the
            scandots and forces of the step before: those of that state were never computed, or are gone.
        """
        self._obs, _, done, _ = self.env.step(self._policy(self._obs))
        self._policy.reset(done)
        self._steps += 1
        before = self._snapshots
        ended = np.flatnonzero(done.cpu().numpy())
        last: dict[int, Snapshot] = {}
        if ended.size:
            qpos, outcomes = self.env.final_qpos.cpu().numpy(), self.env.outcome.cpu().numpy()
            for world in ended.tolist():
                last[world] = replace(
                    before[world],
                    time=self._time(world),
                    qpos=qpos[world, _ROBOT].astype(float),
                    outcome=self.env.outcomes[outcomes[world]],
                    target=_moved(before[world].target, qpos[world, _OBJECT].astype(float)),
                )
                self._scenes[world] = self.env.sim.layout.scene(world)
                self._objects[world] = self._read_object(world)
            self._steps[ended] = 0
            self._episodes[ended] += 1
            self.ended.extend(last.values())
        self._snapshots = self._read()
        return [last.get(world, snapshot) for world, snapshot in enumerate(self._snapshots)]

    def _time(self, world: int) -> float:
        return float(self._steps[world] * self.env.cfg.sim.control_period)

    def _read(self) -> list[Snapshot]:
        qpos = self.env.sim.data.qpos.numpy().astype(float)
        self._follow_scenes()
        scandots, targets, depth = self._read_scandots(qpos), self._read_targets(qpos), self._read_depth()
        stages = self._read_stages()
        return [
            Snapshot(
                scene=self._scenes[world],
                episode=int(self._episodes[world]),
                time=self._time(world),
                qpos=qpos[world, _ROBOT],
                scandots=scandots[world],
                depth=None if depth is None else depth[world],
                target=targets[world],
                stage=stages[world],
                stages=self.env.stages,
            )
            for world in range(self.env.num_envs)
        ]

    def _follow_scenes(self) -> None:
        """Replace the scenes in which something has moved, or that have another goal than before."""
        layout = self.env.sim.layout
        if any(scene.moves for scene in self._scenes):
            pos = layout.pos.numpy().astype(float)
            self._scenes = [
                replace(scene, pos=pos[world]) if scene.moves else scene
                for world, scene in enumerate(self._scenes)
            ]
        if self._goal is not None:
            goal = self._goal.cpu().numpy().astype(float)
            self._scenes = [
                scene if (scene.goal == goal[world]).all() else replace(scene, goal=goal[world])
                for world, scene in enumerate(self._scenes)
            ]

    def _read_stages(self) -> Sequence[str | None]:
        if self._stage is None:
            return [None] * self.env.num_envs
        return [self.env.stages[stage] for stage in self._stage.tolist()]

    def _read_object(self, world: int) -> SceneObject | None:
        return None if self._sight is None else self.env.sim.object.scene_object(world)

    def _read_scandots(self, qpos: np.ndarray) -> Sequence[Scandots | None]:
        if self._scandots is None:
            return [None] * self.env.num_envs
        known, visible = self._scandots.all.numpy(), self._scandots.visible.numpy()
        nearby = self.env.sim.layout.nearby.numpy()
        return [
            scandots_of(known[world], visible[world], scene.is_wall[nearby[world]], qpos[world, :3])
            for world, scene in enumerate(self._scenes)
        ]

    def _read_targets(self, qpos: np.ndarray) -> Sequence[Target | None]:
        if self._sight is None:
            return [None] * self.env.num_envs
        seen, force = self._sight.seen.numpy(), self.env.sim.grasp.finger_force.numpy().sum(-1)
        return [
            None if what is None else Target(what, qpos[w, _OBJECT], bool(seen[w]), float(force[w]))
            for w, what in enumerate(self._objects)
        ]

    def _read_depth(self) -> np.ndarray | None:
        """Images of all worlds as the policy gets them [m], shape (num_envs, rows, columns)."""
        images = self.env.depth
        if images is None:
            return None
        depth = images.pipeline.filter.depth.numpy().astype(float)
        near, far = self.env.depth_ranges().cpu().numpy().T[:, :, None, None]
        return np.clip(np.where(depth > 0.0, depth, np.inf), near, far)


def _moved(target: Target | None, pose: np.ndarray) -> Target | None:
    return None if target is None else replace(target, pose=pose)


def scandots_of(known: np.ndarray, visible: np.ndarray, is_wall: np.ndarray, base: np.ndarray) -> Scandots:
    """Turn tokens into points.

    The corners of what is seen of a wall are not those of its piece in the window, so both are listed; a
    corner of an obstacle is listed once.

    Args:
        known: Tokens of the local window, shape (k, 32).
        visible: Tokens of what the camera sees, shape (k, 32).
        is_wall: Which of them are of walls, shape (k,).
        base: Pose of the base (x [m], y [m], yaw [rad]), shape (3,).
    """
    in_window, seen = known[:, 24:] > 0.5, visible[:, 24:] > 0.5
    unseen = in_window & (is_wall[:, None] | ~seen)
    corners = [tokens[:, :24].reshape(-1, 8, 3)[mask] for tokens, mask in ((known, unseen), (visible, seen))]
    points_b = np.concatenate(corners).astype(float)
    cos, sin = np.cos(base[2]), np.sin(base[2])
    points_w = points_b @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    points_w[:, :2] += base[:2]
    return Scandots(points_w, np.repeat([False, True], [len(part) for part in corners]))
