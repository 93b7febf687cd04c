"""Why episodes of a benchmark of the navigation task fail: the benchmark, with a look at every failure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

from spin_rl.analysis.episodes import replay, run_watched
from spin_rl.analysis.failures.failure import Failure
from spin_rl.analysis.failures.watch import FailureWatch
from spin_rl.benchmark.registry import Benchmark
from spin_rl.policy import PolicyFactory
from spin_rl.scenes.layout import Scene
from spin_rl.tasks.nav.config import NavConfig


def analyse_failures(
    benchmark: Benchmark,
    make_policy: PolicyFactory,
    cfg: NavConfig,
    episodes: int,
    seeds: Sequence[int],
    device: str,
    *,
    overrides: Sequence[str] = (),
    scene: Scene | None = None,
    scene_file: Path | None = None,
    **options: Any,
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
        overrides: Settings of the task that a replay needs as well, for the result.
        scene: The one scene to run in, None for the benchmark's.
        scene_file: Its file.
        options: See `run_watched`.

    Returns:
        The benchmark's result; with `analysis` ("failures"), `failures` (see `Failure`; with `play`, the
        overrides of spin-play that show it) and `durations_s` of all episodes.

    Raises:
        ConfigError: Too few worlds, or whatever the benchmark refuses.
    """
    result, watches, names = run_watched(
        FailureWatch,
        benchmark,
        make_policy,
        cfg,
        episodes,
        seeds,
        device,
        scene=scene,
        scene_file=scene_file,
        **options,
    )
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


def failures_of(result: dict[str, Any]) -> list[Failure]:
    """Read the failures of a result, such as one from a file."""
    names = [field.name for field in fields(Failure)]
    return [Failure(**{name: entry[name] for name in names}) for entry in result["failures"]]
