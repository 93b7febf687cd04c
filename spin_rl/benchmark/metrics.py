"""From finished episodes to the figures of one row of a benchmark."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Self, TypeVar

import numpy as np

from spin_rl import robot
from spin_rl.tasks.common import episode
from spin_rl.tasks.pick import episode as pick_episode

# Two-sided 95% quantile of the standard normal distribution.
_Z95 = 1.959963984540054


def wilson_interval(successes: float, episodes: float) -> tuple[float, float]:
    """95% confidence interval of a success rate (Wilson 1927), which stays honest at rates of 0 and 1.

    Args:
        successes: Number of successes.
        episodes: Number of trials, at least 1. Of trials that are not independent both are as many as have
            their variance, and need not be whole.

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


def paired_interval(differences: np.ndarray) -> tuple[float, float]:
    """95% confidence interval of the mean difference of success rates in the same scenes.

    That of Bonett and Price (2012) for paired proportions: Wald's with one scene more won and one more lost,
    so that it keeps a width where all scenes agree. It covers the choice of scenes, not that of trainings.

    Args:
        differences: In each scene, from -1 to 1; of several trainings that of their means, shape (n,).
    """
    more = np.concatenate([differences, [1.0, -1.0]])
    mean, half = float(more.mean()), _Z95 * float(more.std()) / math.sqrt(len(more))
    return max(mean - half, -1.0), min(mean + half, 1.0)


def mean_interval(values: np.ndarray, draws: int = 2000) -> tuple[float, float]:
    """95% confidence interval of a mean, by the percentiles of a bootstrap (Efron 1979) with a fixed seed.

    Args:
        values: One or more, shape (n,).
        draws: Samples drawn anew.
    """
    chosen = np.random.default_rng(0).integers(len(values), size=(draws, len(values)))
    low, high = np.percentile(values[chosen].mean(axis=1), [2.5, 97.5])
    return float(low), float(high)


@dataclass
class Episodes:
    """How episodes of any task ended, one row each.

    Attributes:
        outcome: Index into the task's outcomes, such as `episode.OUTCOMES`, shape (n,), int.
        steps: Control steps until the end, shape (n,), int.
    """

    outcome: np.ndarray
    steps: np.ndarray

    @staticmethod
    def concatenate(groups: Sequence[Kind]) -> Kind:
        """Join groups of episodes, such as those of several seeds."""
        kind = type(groups[0])
        names = [field.name for field in fields(kind)]
        return kind(**{name: np.concatenate([getattr(group, name) for group in groups]) for name in names})

    def select(self, rows: np.ndarray) -> Self:
        """Return the episodes of an index or mask array."""
        return type(self)(**{field.name: getattr(self, field.name)[rows] for field in fields(self)})


Kind = TypeVar("Kind", bound=Episodes)


def paired_difference(own: Sequence[Episodes], other: Sequence[Episodes]) -> dict[str, Any]:
    """Compare the success of two conditions scene by scene.

    Groups are pooled.

    Args:
        own: Groups of episodes under the first condition.
        other: The same scenes in the same order under the other one.

    Returns:
        `mean` (other minus own), `ci95` (see `paired_interval`), and how many scenes were `won` (success only
        under the other condition) and `lost` (only under the first).
    """
    before, after = (
        np.concatenate([group.outcome == episode.SUCCESS for group in groups]) for groups in (own, other)
    )
    if len(before) != len(after):
        raise ValueError(f"{len(before)} episodes cannot be paired with {len(after)}")
    won, lost = int((after & ~before).sum()), int((before & ~after).sum())
    ci95 = list(paired_interval(after.astype(float) - before))
    return {"mean": (won - lost) / len(before), "ci95": ci95, "won": won, "lost": lost}


@dataclass
class ReachEpisodes(Episodes):
    """How episodes of the navigation task ended.

    Attributes:
        distance: Straight distance to the goal at the end [m], shape (n,).
        parts: Which of `robot.PARTS` touched the scene at the last step, shape (n, 6), bool.
    """

    distance: np.ndarray
    parts: np.ndarray


@dataclass
class DriveEpisodes(ReachEpisodes):
    """How episodes of the navigation task ended, and how far they drove.

    Attributes:
        way: Length of the way to the goal at the start [m], shape (n,).
        driven: Path that the base drove [m], shape (n,).
    """

    way: np.ndarray
    driven: np.ndarray


@dataclass
class PickEpisodes(Episodes):
    """How episodes of the pick task ended.

    Attributes:
        distance: From the grasp centre to the object at the end [m], shape (n,).
        hard_peak: Largest force of a part other than the fingers on the scene [N], shape (n,).
    """

    distance: np.ndarray
    hard_peak: np.ndarray


def spl(success: np.ndarray, way: np.ndarray, driven: np.ndarray) -> float:
    """Success weighted by path length (Anderson et al. 2018): 1 where all succeed and none makes a detour.

    Args:
        success: Which episodes succeeded, shape (n,), bool.
        way: Length of the shortest way [m], shape (n,).
        driven: Path that was driven [m], shape (n,).
    """
    # Who starts at the goal has nothing to drive.
    return float(np.where(success, way / np.maximum(np.maximum(way, driven), 1e-6), 0.0).mean())


def _rates(episodes: Episodes, control_period: float) -> dict[str, Any]:
    """Figures that every task has."""
    count = len(episodes.outcome)
    success = episodes.outcome == episode.SUCCESS
    successes = int(success.sum())
    duration = episodes.steps * control_period
    return {
        "success_rate": successes / count,
        "ci95": list(wilson_interval(successes, count)),
        "duration_s": float(duration[success].mean()) if successes else None,
        "duration_all_s": float(duration.mean()),
        "collision_rate": float((episodes.outcome == episode.COLLISION).mean()),
        "timeout_rate": float((episodes.outcome == episode.TIMEOUT).mean()),
        "non_finite": int((episodes.outcome == episode.NON_FINITE).sum()),
        "episodes": count,
    }


def _shares_of_failures(episodes: Episodes, causes: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Share of the failed episodes with each cause, given as a mask."""
    failures = max(int((episodes.outcome != episode.SUCCESS).sum()), 1)
    return {name: int(mask.sum()) / failures for name, mask in causes.items()}


def summarize(episodes: ReachEpisodes, control_period: float) -> dict[str, Any]:
    """Compute the figures of one cell of the reach benchmark.

    Args:
        episodes: At least one finished episode.
        control_period: Duration of a control step [s].

    Returns:
        `success_rate`, `ci95` (Wilson), `duration_s` (mean over successful episodes [s], None without one),
        `duration_all_s`, `collision_rate`, `timeout_rate`, `non_finite` (a count), `episodes`,
        `final_distance_m` (mean over all), and `causes`: the share of the failed episodes in which each robot
        part collided, or that ended by `timeout` or `non_finite`. Parts that touch at the same step all
        count, so shares may sum to more than 1.
    """
    collision = episodes.outcome == episode.COLLISION
    causes = {part: episodes.parts[:, i] & collision for i, part in enumerate(robot.PARTS)}
    causes["timeout"] = episodes.outcome == episode.TIMEOUT
    causes["non_finite"] = episodes.outcome == episode.NON_FINITE
    return _rates(episodes, control_period) | {
        "final_distance_m": float(episodes.distance.mean()),
        "causes": _shares_of_failures(episodes, causes),
    }


def summarize_drives(episodes: DriveEpisodes, control_period: float) -> dict[str, Any]:
    """Compute the figures of one row of a benchmark of the navigation task.

    Returns:
        As `summarize`, with `spl`, with `final_distance_ci95` (a bootstrap over episodes), and with
        `outcomes`, which lets results of the same scenes be paired: a letter for every episode, the first one
        of the name that `episode.OUTCOMES` has for how it ended.
    """
    success = episodes.outcome == episode.SUCCESS
    return summarize(episodes, control_period) | {
        "spl": spl(success, episodes.way, episodes.driven),
        "final_distance_ci95": mean_interval(episodes.distance),
        "outcomes": "".join(episode.OUTCOMES[outcome][0] for outcome in episodes.outcome),
    }


def summarize_picks(episodes: PickEpisodes, control_period: float) -> dict[str, Any]:
    """Compute the figures of one row of the pick benchmark.

    Args:
        episodes: At least one finished episode.
        control_period: Duration of a control step [s].

    Returns:
        As `summarize`, with `dropped_rate` and `untouched_rate`: the share of all episodes that succeeded and
        in which no part but the fingers touched the scene at all. `collision_rate` is that of hits of table,
        wall or box by another part than the fingers. `causes` are `table hit`, `dropped`, `timeout` and
        `non_finite`, which sum to 1 where anything failed.
    """
    outcomes = {
        "table hit": episode.COLLISION,
        "dropped": pick_episode.DROPPED,
        "timeout": episode.TIMEOUT,
        "non_finite": episode.NON_FINITE,
    }
    causes = {name: episodes.outcome == outcome for name, outcome in outcomes.items()}
    untouched = (episodes.outcome == episode.SUCCESS) & (episodes.hard_peak == 0.0)
    return _rates(episodes, control_period) | {
        "untouched_rate": float(untouched.mean()),
        "dropped_rate": float(causes["dropped"].mean()),
        "final_distance_m": float(episodes.distance.mean()),
        "causes": _shares_of_failures(episodes, causes),
    }
