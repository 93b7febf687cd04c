"""From finished episodes to the figures of one benchmark cell."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from spin_rl import robot
from spin_rl.tasks import episode

# Two-sided 95% quantile of the standard normal distribution.
_Z95 = 1.959963984540054


def wilson_interval(successes: int, episodes: int) -> tuple[float, float]:
    """95% confidence interval of a success rate (Wilson 1927), which stays honest at rates of 0 and 1.

    Args:
        successes: Number of successes.
        episodes: Number of trials, at least 1.

    Raises:
        ValueError: No trials, or more successes than trials.
    """
    if not 0 <= successes <= episodes or episodes < 1:
        raise ValueError(f"no interval for {successes} successes in {episodes} episodes")
    rate = successes / episodes
    scale = 1.0 + _Z95**2 / episodes
    centre = (rate + _Z95**2 / (2 * episodes)) / scale
    half = _Z95 / scale * math.sqrt(rate * (1.0 - rate) / episodes + _Z95**2 / (4 * episodes**2))
    # The ends are exact there; rounding would leave 1e-17.
    low = 0.0 if successes == 0 else centre - half
    high = 1.0 if successes == episodes else centre + half
    return low, high


@dataclass
class Episodes:
    """How episodes ended, one row each.

    Attributes:
        outcome: Index into `episode.OUTCOMES`, shape (n,), int.
        steps: Control steps until the end, shape (n,), int.
        distance: Straight distance to the goal at the end [m], shape (n,).
        parts: Which of `robot.PARTS` touched the scene at the last step, shape (n, 6), bool.
    """

    outcome: np.ndarray
    steps: np.ndarray
    distance: np.ndarray
    parts: np.ndarray

    @staticmethod
    def concatenate(groups: list[Episodes]) -> Episodes:
        """Join groups of episodes, such as those of several seeds."""
        return Episodes(
            *(
                np.concatenate([getattr(group, name) for group in groups])
                for name in ("outcome", "steps", "distance", "parts")
            )
        )

    def select(self, rows: np.ndarray) -> Episodes:
        """Return the episodes of an index or mask array."""
        return Episodes(self.outcome[rows], self.steps[rows], self.distance[rows], self.parts[rows])


def summarize(episodes: Episodes, control_period: float) -> dict[str, Any]:
    """Compute a cell's figures.

    Args:
        episodes: At least one finished episode.
        control_period: Duration of a control step [s].

    Returns:
        `success_rate`, `ci95` (Wilson), `duration_s` (mean over successful episodes [s], None without one),
        `duration_all_s`, `collision_rate`, `timeout_rate`, `non_finite` (a count), `final_distance_m` (mean
        over all), `episodes`, and `causes`: the share of the failed episodes in which each robot part
        collided, or that ended by `timeout` or `non_finite`. Parts that touch at the same step all count, so
        shares may sum to more than 1.
    """
    count = len(episodes.outcome)
    success = episodes.outcome == episode.SUCCESS
    collision = episodes.outcome == episode.COLLISION
    timeout = episodes.outcome == episode.TIMEOUT
    non_finite = episodes.outcome == episode.NON_FINITE
    successes = int(success.sum())
    low, high = wilson_interval(successes, count)
    failures = max(count - successes, 1)
    touched = (episodes.parts & collision[:, None]).sum(0)
    causes = {part: int(n) / failures for part, n in zip(robot.PARTS, touched, strict=True)}
    causes |= {"timeout": int(timeout.sum()) / failures, "non_finite": int(non_finite.sum()) / failures}
    duration = episodes.steps * control_period
    return {
        "success_rate": successes / count,
        "ci95": [low, high],
        "duration_s": float(duration[success].mean()) if successes else None,
        "duration_all_s": float(duration.mean()),
        "collision_rate": float(collision.mean()),
        "timeout_rate": float(timeout.mean()),
        "non_finite": int(non_finite.sum()),
        "final_distance_m": float(episodes.distance.mean()),
        "episodes": count,
        "causes": causes,
    }
