# pyright: reportGeneralTypeIssues=false
# (to a type checker, a Warp struct is an object, not a class)
"""How fetches ended: one row per world on the host, and sums for training-style statistics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
import warp as wp

from spin_rl import robot
from spin_rl.tasks.common import episode
from spin_rl.tasks.common.rewards import Transition
from spin_rl.tasks.common.statistics import Env, EpisodeStatistics, ratio
from spin_rl.tasks.fetch.config import STAGES
from spin_rl.tasks.fetch.state import FETCH_OUTCOMES, FetchRecord


@dataclass
class FetchEpisodes:
    """Finished fetches, one row each.

    Attributes:
        outcome: Index into `FETCH_OUTCOMES`; `running` for worlds whose fetch goes on, shape (n,), int.
        steps: Control steps until the end, shape (n,), int.
        stage: Stage in which it ended, index into `STAGES`, shape (n,), int.
        kind: Index into `objects.OBJECTS`, shape (n,), int.
        stage_steps: Control steps spent in each stage, shape (n, 6), int.
        reached: Whether the robot came to the table, shape (n,), bool.
        picked: Whether it lifted the object and held it up, shape (n,), bool.
        retries: Further attempts to pick, shape (n,), int.
        drops: How often the fingers lost the object after it had been picked, shape (n,), int.
        scrapes: Steps in which the carried object touched the scene, shape (n,), int.
        distance: From the robot's start to the object at the end [m], shape (n,).
        parts: Which of `robot.PARTS` touched the scene at the last step, shape (n, 6), bool.
    """

    outcome: np.ndarray
    steps: np.ndarray
    stage: np.ndarray
    kind: np.ndarray
    stage_steps: np.ndarray
    reached: np.ndarray
    picked: np.ndarray
    retries: np.ndarray
    drops: np.ndarray
    scrapes: np.ndarray
    distance: np.ndarray
    parts: np.ndarray

    @property
    def ended(self) -> np.ndarray:
        """Whether the fetch is over, shape (n,), bool."""
        return self.outcome != episode.RUNNING

    @property
    def placed(self) -> np.ndarray:
        """Whether the whole fetch succeeded, shape (n,), bool."""
        return self.outcome == episode.SUCCESS

    def cause(self, row: int) -> str:
        """Say in which stage and how a fetch ended, with the robot's parts that touched the scene."""
        outcome = int(self.outcome[row])
        if outcome in (episode.RUNNING, episode.SUCCESS):
            return FETCH_OUTCOMES[outcome]
        text = f"{STAGES[int(self.stage[row])]} {FETCH_OUTCOMES[outcome]}"
        if outcome == episode.COLLISION:
            hit = [part for part, touched in zip(robot.PARTS, self.parts[row], strict=True) if touched]
            text += f" {'+'.join(hit)}" if hit else ""
        return text


def record_views(record: FetchRecord) -> dict[str, torch.Tensor]:
    """Return Torch views of a record's arrays by the names of `FetchEpisodes`, without `steps`."""
    views = {name: wp.to_torch(getattr(record, name)) for name in FetchRecord.vars}
    views["stage_steps"] = views.pop("steps")
    return views


def read_record(record: FetchRecord) -> FetchEpisodes:
    """Copy a record to the host; waits for the device."""
    facts = {name: view.cpu().numpy().copy() for name, view in record_views(record).items()}
    return FetchEpisodes(steps=facts["stage_steps"].sum(1), **facts)


@dataclass
class FetchStep(Transition):
    """What a control step of a fetch did.

    Attributes:
        reached: Whether the fetch has come to the table so far, shape (num_envs,), bool.
        picked: Whether it has picked the object so far, shape (num_envs,), bool.
    """

    reached: torch.Tensor
    picked: torch.Tensor


class FetchStatistics(EpisodeStatistics):
    """Adds `reached_rate` and `picked_rate`; `success_rate` is that of whole fetches."""

    def __init__(self, num_envs: int, device: str) -> None:
        """Allocate the sums for a number of worlds."""
        super().__init__(num_envs, (), device, outcomes=FETCH_OUTCOMES, sums=("reached", "picked"))

    def _task_sums(self, env: Env, done: torch.Tensor) -> torch.Tensor:
        step = env.last_transition
        return torch.stack([(flag * done).sum() for flag in (step.reached, step.picked)])

    def _task_stats(self, sums: dict[str, float]) -> dict[str, float]:
        return {f"{name}_rate": ratio(sums, name, "episodes") for name in ("reached", "picked")}
