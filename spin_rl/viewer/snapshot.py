"""One world at one time, as plain NumPy: what all views show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spin_rl import robot
from spin_rl.scenes.layout import Scene
from spin_rl.scenes.objects.shapes import SceneObject
from spin_rl.tasks.common import episode

RUNNING = episode.OUTCOMES[episode.RUNNING]


@dataclass(frozen=True)
class Scandots:
    """The scandots of one world at one time.

    Attributes:
        points: Corners in the local window, then corners of the pieces of walls that the camera sees, in the
            world frame [m], shape (n, 3).
        seen: Whether the policy gets them, shape (n,), bool.
    """

    points: np.ndarray
    seen: np.ndarray


@dataclass(frozen=True)
class Target:
    """The object to pick up in one world at one time.

    Attributes:
        what: Shape, and where the episode began; the same object for all snapshots of an episode.
        pose: Position of its centre [m] and orientation (w, x, y, z), world, shape (7,).
        seen: Whether the camera sees it.
        force: Of both fingertips together on it [N].
    """

    what: SceneObject
    pose: np.ndarray
    seen: bool
    force: float

    @property
    def height(self) -> float:
        """Height over where it was at the start of the episode [m]."""
        return float(self.pose[2] - self.what.start_pose[2])


@dataclass(frozen=True)
class Snapshot:
    """One world at one time.

    Attributes:
        scene: What stands in the world, and the goal of now. The same object for all snapshots of an episode
            until something moves or the goal changes; then positions and goal alone differ.
        episode: Number of the episode in its world, from 0.
        time: Since the start of the episode [s].
        qpos: Positions in `robot.DOF_NAMES` order [m, rad], shape (13,).
        scandots: What is near, and what of it is seen; None where the task has no scandots.
        outcome: One of the task's outcomes; other than "running" in an episode's last snapshot.
        depth: The depth image as the policy gets it, noisy and filtered, upright, in metres between the
            nearest and the farthest depth that it can tell apart, shape (rows, columns); None where the
            task has no depth camera.
        target: The object to pick up, where the task has one.
        stage: One of `stages`, where the task has stages.
        stages: Names of the stages of the task's episodes in their order.
    """

    scene: Scene
    episode: int
    time: float
    qpos: np.ndarray
    scandots: Scandots | None
    outcome: str = RUNNING
    depth: np.ndarray | None = None
    target: Target | None = None
    stage: str | None = None
    stages: tuple[str, ...] = ()

    @property
    def marks(self) -> Scandots:
        """The points that the policy is given while they are seen: scandots, and the object's centre."""
        marks = self.scandots or Scandots(np.zeros((0, 3)), np.zeros(0, dtype=bool))
        if self.target is None:
            return marks
        points = np.concatenate((marks.points, self.target.pose[None, :3]))
        return Scandots(points, np.append(marks.seen, self.target.seen))

    @property
    def ended(self) -> bool:
        """Whether this is the last snapshot of its episode."""
        return self.outcome != RUNNING

    @property
    def goal_distance(self) -> float:
        """Straight distance from the base to the goal [m]."""
        return float(np.hypot(*(self.scene.goal - self.qpos[:2])))

    @property
    def put_distance(self) -> float:
        """Distance of the object from where the robot started, across the floor [m]; there is an object."""
        assert self.target is not None
        return float(np.hypot(*(self.target.pose[:2] - self.scene.start[:2])))

    @property
    def cause(self) -> str:
        """How the episode ended, after the stage in which it failed, if any."""
        failed = self.stage is not None and self.outcome != "success"
        return f"{self.stage} {self.outcome}" if failed else self.outcome

    def joint(self, name: str) -> float:
        """Position of a joint of the MJCF [m or rad]."""
        return float(self.qpos[robot.DOF_NAMES.index(name)])
