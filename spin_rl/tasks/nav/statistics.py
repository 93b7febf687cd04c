"""What navigation adds to the sums over episodes."""

from __future__ import annotations

from typing import Any

import torch

from spin_rl import robot
from spin_rl.tasks.common import episode
from spin_rl.tasks.common.statistics import EpisodeStatistics, ratio


class NavStatistics(EpisodeStatistics):
    """Adds the distance to the goal, what the guard did and the parts that collided.

    Keys: `final_distance_m`; `guarded_share`, the share of control steps in which it changed the action; and
    `collisions/<part>`, the share of all episodes that ended with that part touching.
    """

    def __init__(self, num_envs: int, reward_terms: tuple[str, ...], device: str) -> None:
        """Allocate the sums, arguments as of `EpisodeStatistics`."""
        parts = tuple(f"part/{name}" for name in robot.PARTS)
        super().__init__(num_envs, reward_terms, device, sums=("goal_distance", "guarded", *parts))

    def _task_sums(self, env: Any, done: torch.Tensor) -> torch.Tensor:
        collided = (env.outcome == episode.COLLISION).float()
        parts = (env.sim.views.part_contacts * collided[:, None]).sum(0)
        guarded = done.new_zeros(()) if env.guard is None else env.guard.guarded.sum()
        return torch.cat((torch.stack(((env.last_transition.goal_distance * done).sum(), guarded)), parts))

    def _task_stats(self, sums: dict[str, float]) -> dict[str, float]:
        stats = {"final_distance_m": ratio(sums, "goal_distance", "episodes")}
        stats["guarded_share"] = ratio(sums, "guarded", "steps")
        return stats | {f"collisions/{part}": ratio(sums, f"part/{part}", "episodes") for part in robot.PARTS}
