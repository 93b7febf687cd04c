"""Statistics of the pick task."""

from __future__ import annotations

import torch

from spin_rl.scenes.objects.shapes import OBJECTS
from spin_rl.tasks.common import episode
from spin_rl.tasks.common.statistics import Env, EpisodeStatistics, ratio
from spin_rl.tasks.pick.episode import PICK_OUTCOMES

_PER_EPISODE = ("collision", "dropped", "distance", "far", "far_success")
_PER_STEP = ("seen", "touch", "grasp", "table_force")


class PickStatistics(EpisodeStatistics):
    """Adds what became of each object, and how much was seen, touched and grasped.

    Keys: `object/<kind>`, the success rate of its episodes, and `far_success_rate`, that of starts not near
    the object; `table_hit_rate` and `object_lost_rate`, shares of all episodes that ended so, whether or not
    there had been a success; `final_distance_m` from the grasp centre to the object; means over the control
    steps: `seen` and `grasped`, shares, `touching_fingers`, and `table_force_n`.
    """

    def __init__(
        self,
        num_envs: int,
        reward_terms: tuple[str, ...],
        device: str,
        *,
        kind: torch.Tensor,
        near: torch.Tensor,
        seen: torch.Tensor,
    ) -> None:
        """Allocate the sums.

        Args:
            num_envs: Number of worlds.
            reward_terms: Names of the reward terms in use.
            device: Torch device.
            kind: Index into `objects.OBJECTS`, a view, shape (num_envs,), int32.
            near: Whether the episode started near the object, a view, shape (num_envs,), bool.
            seen: Whether the camera sees the object, a view, shape (num_envs,), bool.
        """
        kinds = [f"{what}/{name}" for what in ("tried", "success") for name in OBJECTS]
        super().__init__(
            num_envs, reward_terms, device, outcomes=PICK_OUTCOMES, sums=(*_PER_EPISODE, *_PER_STEP, *kinds)
        )
        self._kind = kind
        self._kind_before = kind.clone()
        self._near = near
        self._near_before = near.clone()
        self._seen = seen
        self._kinds = torch.arange(len(OBJECTS), dtype=torch.int32, device=device)

    def before_step(self) -> None:
        """Keep what the episodes began with: worlds that end begin others."""
        self._kind_before.copy_(self._kind)
        self._near_before.copy_(self._near)

    def _task_sums(self, env: Env, done: torch.Tensor) -> torch.Tensor:
        step = env.last_transition
        success = (env.outcome == episode.SUCCESS).float()
        far = (~self._near_before).float()
        per_episode = torch.stack(
            (step.collision.float(), step.dropped.float(), step.distance, far, far * success)
        )
        per_step = torch.stack(
            (
                self._seen.float(),
                (step.finger_force > 0.0).float().sum(-1),
                step.grasped.float(),
                step.table_force,
            )
        )
        tried = (self._kind_before[:, None] == self._kinds) * done[:, None]
        succeeded = success[:, None] * tried
        return torch.cat(((per_episode * done).sum(-1), per_step.sum(-1), tried.sum(0), succeeded.sum(0)))

    def _task_stats(self, sums: dict[str, float]) -> dict[str, float]:
        stats = {
            "far_success_rate": ratio(sums, "far_success", "far"),
            "table_hit_rate": ratio(sums, "collision", "episodes"),
            "object_lost_rate": ratio(sums, "dropped", "episodes"),
            "final_distance_m": ratio(sums, "distance", "episodes"),
            "seen": ratio(sums, "seen", "steps"),
            "touching_fingers": ratio(sums, "touch", "steps"),
            "grasped": ratio(sums, "grasp", "steps"),
            "table_force_n": ratio(sums, "table_force", "steps"),
        }
        return stats | {f"object/{name}": ratio(sums, f"success/{name}", f"tried/{name}") for name in OBJECTS}
