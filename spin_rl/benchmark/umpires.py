"""Who says when an episode of the robot in C MuJoCo is over, by the rules of the batched tasks."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from spin_rl import robot
from spin_rl.sim.model import geom_parts
from spin_rl.tasks.common import episode


class DriveUmpire:
    """Ends a drive when a part of the robot touches the scene or the floor, as `tasks.nav.episode` does.

    Attributes:
        outcome: Of an episode that is over.
    """

    outcome = episode.COLLISION

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Look at the robot at its start."""
        self._part = np.array(geom_parts(model))
        stands = model.geom_bodyid == 0
        self._is_scene = stands | (model.body_mocapid[model.geom_bodyid] >= 0)
        self._parts = np.zeros(len(robot.PARTS), dtype=bool)
        self._place, self._driven = data.qpos[:2].copy(), 0.0

    @property
    def is_over(self) -> bool:
        """Whether something touched."""
        return bool(self._parts.any())

    def add_substep(self, data: mujoco.MjData) -> None:
        """Note what penetrates the scene."""
        for first, second in data.contact.geom[data.contact.dist < 0.0]:
            for geom, other in ((first, second), (second, first)):
                if self._part[geom] >= 0 and self._is_scene[other]:
                    self._parts[self._part[geom]] = True

    def judge(self, data: mujoco.MjData) -> None:
        """Add the way of a control step."""
        self._driven += float(np.linalg.norm(data.qpos[:2] - self._place))
        self._place = data.qpos[:2].copy()

    def figures(self, goal: np.ndarray) -> dict[str, Any]:
        """What `metrics.DriveEpisodes` holds of the episode beside its end."""
        distance = float(np.linalg.norm(goal - self._place))
        return {"distance": distance, "parts": self._parts, "driven": self._driven}
