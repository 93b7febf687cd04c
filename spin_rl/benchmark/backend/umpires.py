"""Who says when an episode of the robot in C MuJoCo is over, by the rules of the batched tasks."""

from __future__ import annotations

from typing import Any, Protocol

import mujoco
import numpy as np

from spin_rl import robot
from spin_rl.deploy.backends import mujoco as backend
from spin_rl.deploy.backends.handled import HandledObject
from spin_rl.deploy.fetch import numbers as n
from spin_rl.deploy.fetch.agent import FetchAgent
from spin_rl.sim.model import geom_parts
from spin_rl.tasks.common import episode
from spin_rl.tasks.pick import episode as pick_episode
from spin_rl.tasks.pick.config import PickConfig


class Umpire(backend.Umpire, Protocol):
    """Also says how an episode ended.

    Attributes:
        outcome: Of an episode that is over.
    """

    outcome: int

    def figures(self, data: mujoco.MjData) -> dict[str, Any]:
        """What the task's `metrics.Episodes` hold of the episode beside outcome and steps."""
        ...


class _Touches:
    """Which parts of the robot penetrate the scene or the floor, as `warp_kernels.contacts` has it.

    Attributes:
        parts: Which of `robot.PARTS`, shape (6,), bool.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._part = np.array(geom_parts(model))
        stands = model.geom_bodyid == 0
        self._is_scene = stands | (model.body_mocapid[model.geom_bodyid] >= 0)
        self.clear()

    def clear(self) -> None:
        self.parts = np.zeros(len(robot.PARTS), dtype=bool)

    def add(self, data: mujoco.MjData) -> None:
        for first, second in data.contact.geom[data.contact.dist < 0.0]:
            for geom, other in ((first, second), (second, first)):
                if self._part[geom] >= 0 and self._is_scene[other]:
                    self.parts[self._part[geom]] = True


class DriveUmpire:
    """Ends a drive when a part of the robot touches the scene or the floor, as `tasks.nav.episode` does.

    The goal, and when the time is over, are the control loop's.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, goal: np.ndarray, way: float) -> None:
        """Look at the robot at its start.

        Args:
            model: The robot in its scene.
            data: Its state.
            goal: Where to [m], shape (2,).
            way: How far that is [m].
        """
        self.outcome: int = episode.COLLISION
        self._goal, self._way = goal, way
        self._touches = _Touches(model)
        self._place, self._driven = data.qpos[:2].copy(), 0.0

    @property
    def is_over(self) -> bool:
        """Whether something touched."""
        return bool(self._touches.parts.any())

    def add_substep(self, data: mujoco.MjData) -> None:
        """Note what penetrates the scene."""
        self._touches.add(data)

    def judge(self, data: mujoco.MjData) -> None:
        """Add the way of a control step."""
        self._driven += float(np.linalg.norm(data.qpos[:2] - self._place))
        self._place = data.qpos[:2].copy()

    def figures(self, data: mujoco.MjData) -> dict[str, Any]:
        """What `metrics.DriveEpisodes` hold of the episode beside outcome and steps."""
        distance = float(np.linalg.norm(self._goal - data.qpos[:2]))
        return {"distance": distance, "parts": self._touches.parts, "driven": self._driven, "way": self._way}


class PickUmpire:
    """Ends a pick with the first success, a hit or a lost object, as `tasks.pick.episode` does."""

    def __init__(
        self, model: mujoco.MjModel, handled: HandledObject, half_height: float, cfg: PickConfig
    ) -> None:
        """Look at the object at its start.

        Args:
            model: The robot, the table and the object.
            handled: Knows the forces on hand and object.
            half_height: Of the object as it stands [m].
            cfg: The rules.
        """
        self.outcome: int = episode.RUNNING
        self._model, self._handled, self._half_height, self._cfg = model, handled, half_height, cfg
        self._hold_steps = round(cfg.hold_s / cfg.sim.control_period)
        self._at = len(robot.DOF_NAMES)
        self._held, self._hard_peak = 0, 0.0

    @property
    def is_over(self) -> bool:
        """Whether it is decided."""
        return self.outcome != episode.RUNNING

    def add_substep(self, data: mujoco.MjData) -> None:
        """Do nothing: the forces are noted by the robot's back end."""

    def judge(self, data: mujoco.MjData) -> None:
        """Look at forces and height."""
        grip, cfg = self._handled.grip, self._cfg
        height = float(data.qpos[self._at + 2] - self._handled.start[2])
        is_grasped = sum(grip.fingers_n) > cfg.grasp_force_n and min(grip.fingers_n) > cfg.finger_force_n
        is_lifted = height > cfg.lift_m and is_grasped and not grip.is_supported
        self._held = self._held + 1 if is_lifted else 0
        self._hard_peak = max(self._hard_peak, grip.hard_n)
        if grip.hard_n > cfg.hard_force_n:
            self.outcome = episode.COLLISION
        elif height + self._half_height < -cfg.fall_m:
            self.outcome = int(pick_episode.DROPPED)
        elif self._held >= self._hold_steps:
            self.outcome = episode.SUCCESS

    def figures(self, data: mujoco.MjData) -> dict[str, Any]:
        """What `metrics.PickEpisodes` hold of the episode beside outcome and steps."""
        mujoco.mj_kinematics(self._model, data)
        offset = data.qpos[self._at : self._at + 3] - data.site(robot.GRASP_CENTER_SITE).xpos
        return {"distance": float(np.linalg.norm(offset)), "hard_peak": self._hard_peak}


class FetchUmpire:
    """Counts what becomes of a fetch; ends it with a touch while a policy drives.

    So does `tasks.fetch.stages`. All else that ends a fetch is the agent's.

    Attributes:
        outcome: Of a fetch that is ended here.
        is_over: Whether it is.
    """

    def __init__(self, model: mujoco.MjModel, handled: HandledObject, agent: FetchAgent, kind: int) -> None:
        """Look at a fetch before its first step.

        Args:
            model: The robot, the corridor and the object.
            handled: Knows the forces on hand and object.
            agent: Knows the stage.
            kind: Of the object, index into `objects.OBJECTS`.
        """
        self.outcome: int = episode.COLLISION
        self.is_over = False
        self._handled, self._agent, self._kind = handled, agent, kind
        self._touches, self._is_new = _Touches(model), True
        self._stage_steps = np.zeros(len(n.STAGES), dtype=int)
        self._stage, self._drops, self._scrapes = n.REACH, 0, 0

    def add_substep(self, data: mujoco.MjData) -> None:
        """Note what penetrates the scene in this control step."""
        if self._is_new:
            self._touches.clear()
        self._touches.add(data)
        self._is_new = False

    def judge(self, data: mujoco.MjData) -> None:
        """Count a control step of the present stage."""
        stage, before = self._agent.memory.stage, self._stage
        self._stage, self._is_new = stage, True
        self._stage_steps[stage] += 1
        self._drops += before == n.RETRACT and stage == n.ALIGN  # what was picked lies on the table again
        self._scrapes += stage == n.CARRY and self._handled.grip.is_supported
        self.is_over = stage in (n.REACH, n.CARRY) and bool(self._touches.parts.any())

    def figures(self, data: mujoco.MjData) -> dict[str, Any]:
        """What `fetch.Fetches` hold of the fetch beside outcome and steps."""
        m = self._agent.memory
        at = len(robot.DOF_NAMES)
        return {
            "stage": m.stage,
            "kind": self._kind,
            "stage_steps": self._stage_steps,
            "reached": m.stage > n.REACH,
            "picked": self._stage_steps[n.RETRACT] > 0,
            "retries": m.retries,
            "drops": self._drops + (m.loose >= n.LOOSE_STEPS),
            "scrapes": self._scrapes,
            "distance": float(np.linalg.norm(data.qpos[at : at + 2] - m.home)),
            "parts": self._touches.parts,
        }
