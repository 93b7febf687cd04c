"""Reading an environment while it runs: every world as plain NumPy."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from spin_rl import robot
from spin_rl.scenes.objects.shapes import SceneObject
from spin_rl.tasks.common.env import TaskEnv
from spin_rl.viewer.snapshot import Scandots, Snapshot, Target

ROBOT = slice(len(robot.DOF_NAMES))
OBJECT = slice(ROBOT.stop, None)
"""Of qpos."""


class SnapshotReader:
    """Knows which episode every world is in, and for how long; tell it of every step and new episode."""

    def __init__(self, env: TaskEnv) -> None:
        """Take over an environment at the start of its first episodes; see `restart`."""
        self._env = env
        # What only some tasks have.
        self._goal, self._scandots, self._sight, self._stage = (
            getattr(env, name, None) for name in ("goal", "scandots", "sight", "stage")
        )
        self.restart()

    def restart(self) -> None:
        """All worlds are at the start of their first episodes."""
        n = self._env.num_envs
        self._steps = np.zeros(n, dtype=int)
        self._episodes = np.zeros(n, dtype=int)
        self._scenes = self._env.sim.layout.scenes()
        self._objects = [self._read_object(world) for world in range(n)]

    def count_step(self) -> None:
        """All worlds have made a step."""
        self._steps += 1

    def begin(self, worlds: Iterable[int]) -> None:
        """Some worlds are at the start of their next episodes."""
        for world in worlds:
            self._steps[world] = 0
            self._episodes[world] += 1
            self._scenes[world] = self._env.sim.layout.scene(world)
            self._objects[world] = self._read_object(world)

    def time(self, world: int) -> float:
        """Time since the start of a world's episode [s]."""
        return float(self._steps[world] * self._env.cfg.sim.control_period)

    def read(self) -> list[Snapshot]:
        """Return a snapshot of every world now."""
        qpos = self._env.sim.data.qpos.numpy().astype(float)
        self._follow_scenes()
        scandots, targets, depth = self._read_scandots(qpos), self._read_targets(qpos), self._read_depth()
        stages = self._read_stages()
        return [
            Snapshot(
                scene=self._scenes[world],
                episode=int(self._episodes[world]),
                time=self.time(world),
                qpos=qpos[world, ROBOT],
                scandots=scandots[world],
                depth=None if depth is None else depth[world],
                target=targets[world],
                stage=stages[world],
                stages=self._env.stages,
            )
            for world in range(self._env.num_envs)
        ]

    def _follow_scenes(self) -> None:
        """Replace the scenes in which something has moved, or that have another goal than before."""
        layout = self._env.sim.layout
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
            return [None] * self._env.num_envs
        return [self._env.stages[stage] for stage in self._stage.tolist()]

    def _read_object(self, world: int) -> SceneObject | None:
        return None if self._sight is None else self._env.sim.object.scene_object(world)

    def _read_scandots(self, qpos: np.ndarray) -> Sequence[Scandots | None]:
        if self._scandots is None:
            return [None] * self._env.num_envs
        known, visible = self._scandots.all.numpy(), self._scandots.visible.numpy()
        nearby = self._env.sim.layout.nearby.numpy()
        return [
            scandots_of(known[world], visible[world], scene.is_wall[nearby[world]], qpos[world, :3])
            for world, scene in enumerate(self._scenes)
        ]

    def _read_targets(self, qpos: np.ndarray) -> Sequence[Target | None]:
        if self._sight is None:
            return [None] * self._env.num_envs
        seen, force = self._sight.seen.numpy(), self._env.sim.grasp.finger_force.numpy().sum(-1)
        return [
            None if what is None else Target(what, qpos[w, OBJECT], bool(seen[w]), float(force[w]))
            for w, what in enumerate(self._objects)
        ]

    def _read_depth(self) -> np.ndarray | None:
        """Images of all worlds as the policy gets them [m], shape (num_envs, rows, columns)."""
        images = self._env.depth
        if images is None:
            return None
        depth = images.pipeline.filter.depth.numpy().astype(float)
        near, far = self._env.depth_ranges().cpu().numpy().T[:, :, None, None]
        return np.clip(np.where(depth > 0.0, depth, np.inf), near, far)


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
