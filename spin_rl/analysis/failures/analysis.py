"""Why episodes of a benchmark of the navigation task fail: the benchmark, with a look at every failure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

from spin_rl.analysis.failures.failure import Failure
from spin_rl.analysis.failures.watch import FailureWatch
from spin_rl.benchmark.registry import Benchmark
from spin_rl.benchmark.rounds import Announce, Report
from spin_rl.policy import Policy, PolicyFactory
from spin_rl.scenes.layout import Scene
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.env import NavEnv


def analyse_failures(
    benchmark: Benchmark,
    make_policy: PolicyFactory,
    cfg: NavConfig,
    episodes: int,
    seeds: Sequence[int],
    device: str,
    *,
    policy_name: str = "policy",
    overrides: Sequence[str] = (),
    num_envs: int | None = None,
    scene: Scene | None = None,
    scene_file: Path | None = None,
    announce: Announce | None = None,
    report: Report = print,
) -> dict[str, Any]:
    """Run a benchmark and look at every failure.

    All episodes of a seed run at once, so that seed and world say which scene it was. The episodes are those
    of the benchmark if that, too, runs all episodes of a seed at once.

    Args:
        benchmark: One of the navigation task.
        make_policy: Makes the policy once observations exist.
        cfg: Task configuration.
        episodes: Episodes per condition (cell, family or scene) and seed.
        seeds: Seeds, all different.
        device: "cpu" or "cuda:N".
        policy_name: For the result.
        overrides: Settings of the task that a replay needs as well, for the result.
        num_envs: Most worlds at once; must hold all episodes of a seed.
        scene: The one scene to run in, None for the benchmark's.
        scene_file: Its file.
        announce: Context manager factory around work that may compile kernels.
        report: Receives lines of progress.

    Returns:
        The benchmark's result; with `analysis` ("failures"), `failures` (see `Failure`; with `play`, the
        overrides of spin-play that show it) and `durations_s` of all episodes.

    Raises:
        ConfigError: Too few worlds, or whatever the benchmark refuses.
    """
    watches: list[FailureWatch] = []

    def watch(env: NavEnv, policy: Policy, seed: int) -> Policy:
        watches.append(FailureWatch(policy, env, seed))
        return watches[-1]

    fixed = {} if scene is None or scene_file is None else {"scene": scene, "scene_name": scene_file.name}
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
        **fixed,
    )
    # Conditions take turns over the worlds of a batch.
    names = [condition_of(row) for row in result["rows"]]
    failures = [
        replace(failure, condition=names[failure.world % len(names)])
        for watched in watches
        for failure in watched.failures
    ]
    return result | {
        "analysis": "failures",
        "failures": [
            asdict(failure) | {"play": replay(failure, result, scene_file, overrides)} for failure in failures
        ],
        "durations_s": [duration for watched in watches for duration in watched.durations_s],
    }


def condition_of(row: dict[str, Any]) -> str:
    """Name a benchmark's row: its family, its scene or its cell's scenario and difficulty."""
    for key in ("family", "scene"):
        if key in row:
            return row[key]
    return row["scenario"] if isinstance(row["scenario"], str) else f"{row['scenario']} {row['difficulty']}"


def replay(
    failure: Failure, result: dict[str, Any], scene_file: Path | None = None, overrides: Sequence[str] = ()
) -> str:
    """Return the overrides of spin-play, beside the policy, that play a failure's episode again.

    Args:
        failure: With its condition.
        result: Of the benchmark.
        scene_file: Of the one scene that it ran in, if so.
        overrides: Settings of the task.
    """
    again = {"seed": failure.seed, "world": failure.world}
    if result["benchmark"] == "rooms":
        keys = {"family": failure.condition} | again
    elif result["benchmark"] == "scenes":
        keys = {
            "scene": scene_file or f"{failure.condition}.yaml",
            "starts": result["episodes_per_seed"],
            "trip": failure.world // len(result["rows"]),
            "seed": failure.seed,
        }
    elif scene_file is not None:
        keys = {"scene": scene_file}
    else:
        scenario, difficulty = failure.condition.split()
        keys = {"scenario": scenario, "difficulty": difficulty} | again
    return " ".join([*(f"{key}={value}" for key, value in keys.items()), *overrides])


def failures_of(result: dict[str, Any]) -> list[Failure]:
    """Read the failures of a result, such as one from a file."""
    names = [field.name for field in fields(Failure)]
    return [Failure(**{name: entry[name] for name in names}) for entry in result["failures"]]
