"""Episodes of a benchmark under observation, and how to look at one of them again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol, TypeVar

from spin_rl.analysis.watch import Watch
from spin_rl.benchmark.registry import Benchmark
from spin_rl.benchmark.rounds import Announce, Report
from spin_rl.policy import Policy, PolicyFactory
from spin_rl.scenes.layout import Scene
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.env import NavEnv

Watching = TypeVar("Watching", bound=Watch)


class Numbered(Protocol):
    """Something about an episode that says which it is: its seed, world and condition."""

    @property
    def seed(self) -> int:
        """Of the benchmark."""
        ...

    @property
    def world(self) -> int:
        """Number in the seed's batch."""
        ...

    @property
    def condition(self) -> str:
        """Cell, family or scene, as `condition_of` names it."""
        ...


def run_watched(
    make_watch: Callable[[Policy, NavEnv, int], Watching],
    benchmark: Benchmark,
    make_policy: PolicyFactory,
    cfg: NavConfig,
    episodes: int,
    seeds: Sequence[int],
    device: str,
    *,
    policy_name: str = "policy",
    pick_name: str | None = None,
    num_envs: int | None = None,
    scene: Scene | None = None,
    scene_file: Path | None = None,
    announce: Announce | None = None,
    report: Report = print,
) -> tuple[dict[str, Any], list[Watching], list[str]]:
    """Run a benchmark of the navigation task, or of fetches, with something that looks on.

    All episodes of a seed run at once, so that seed and world say which scene it was. The episodes are those
    of the benchmark if that, too, runs all episodes of a seed at once.

    Args:
        make_watch: Puts it around the policy in an environment for a seed.
        benchmark: The benchmark.
        make_policy: Makes the policy once observations exist.
        cfg: Task configuration.
        episodes: Episodes per condition (cell, family or scene) and seed.
        seeds: Seeds, all different.
        device: "cpu" or "cuda:N".
        policy_name: For the result.
        pick_name: In fetches, that of the policy that picks.
        num_envs: Most worlds at once; must hold all episodes of a seed.
        scene: The one scene to run in, None for the benchmark's.
        scene_file: Its file.
        announce: Context manager factory around work that may compile kernels.
        report: Receives lines of progress.

    Returns:
        The benchmark's result, what looked on, one a seed, and the names of the conditions, which take turns
        over the worlds of a batch.

    Raises:
        ConfigError: Too few worlds, or whatever the benchmark refuses.
    """
    watches: list[Watching] = []

    def watch(env: NavEnv, policy: Policy, seed: int) -> Policy:
        watches.append(make_watch(policy, env, seed))
        return watches[-1]

    own = {} if scene is None or scene_file is None else {"scene": scene, "scene_name": scene_file.name}
    if pick_name is not None:
        own["pick_name"] = pick_name
    result = benchmark.evaluate(
        make_policy,
        cfg,
        episodes,
        seeds,
        device,
        policy_name=policy_name,
        num_envs=num_envs,
        announce=announce,
        report=report,
        watch=watch,
        **own,
    )
    return result, watches, [condition_of(row) for row in result["rows"]]


def condition_of(row: dict[str, Any]) -> str:
    """Name a benchmark's row: its family, its scene or its cell's scenario and difficulty."""
    for key in ("family", "scene"):
        if key in row:
            return row[key]
    return row["scenario"] if isinstance(row["scenario"], str) else f"{row['scenario']} {row['difficulty']}"


def replay(
    which: Numbered, result: dict[str, Any], scene_file: Path | None = None, overrides: Sequence[str] = ()
) -> str:
    """Return the overrides of spin-play, beside the policy, that play an episode again.

    Args:
        which: Something about it, with its condition.
        result: Of the benchmark.
        scene_file: Of the one scene that it ran in, if so.
        overrides: Settings of the task.
    """
    again = {"seed": which.seed, "world": which.world}
    if result["benchmark"] == "rooms":
        keys = {"family": which.condition} | again
    elif result["benchmark"] == "scenes":
        keys = {
            "scene": scene_file or f"{which.condition}.yaml",
            "starts": result["episodes_per_seed"],
            "trip": which.world // len(result["rows"]),
            "seed": which.seed,
        }
    elif scene_file is not None:
        keys = {"scene": scene_file}
    else:
        scenario, difficulty = which.condition.split()
        keys = {"scenario": scenario, "difficulty": difficulty} | again
    return " ".join([*(f"{key}={value}" for key, value in keys.items()), *overrides])
