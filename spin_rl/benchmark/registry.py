"""The benchmarks by name: the task that each measures, how it is run, and how its results are told."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

from spin_rl.benchmark.tables import dynamic as dynamic_report
from spin_rl.benchmark.tables import fetch as fetch_report
from spin_rl.benchmark.tables import pick as pick_report
from spin_rl.benchmark.tables import reach as report
from spin_rl.benchmark.tables import rooms as places
from spin_rl.config import ConfigError, short
from spin_rl.deferred import Deferred


@dataclass(frozen=True)
class Benchmark:
    """One benchmark.

    Attributes:
        name: Its name.
        task: The task that it measures, a file in conf/task.
        scene: Its distribution of scenes, a file in conf/scene.
        evaluate: Runs it: policy factory, task configuration, episodes, seeds and device, and by keyword
            `num_envs`, `announce` and the name of each policy that takes turns, such as `policy_name`; with
            `scene_files` also `scene` and `scene_name`. Returns the result.
        table: Formats a result for the terminal.
        headline: One line that sums a result up.
        scene_files: Whether it can be run in a scene file.
        families: Whether its conditions are scene families.
    """

    name: str
    task: str
    scene: str
    evaluate: Callable[..., dict[str, Any]]
    table: Callable[[dict[str, Any]], str]
    headline: Callable[[dict[str, Any]], str]
    scene_files: bool = False
    families: bool = False


def _run(module: str, name: str) -> Callable[..., dict[str, Any]]:
    return Deferred(f"spin_rl.benchmark.{module}:{name}")


_ALL = (
    Benchmark(
        "reach",
        "nav",
        "nav",
        _run("reach", "evaluate_reach"),
        report.table,
        report.headline,
        scene_files=True,
    ),
    Benchmark(
        "rooms",
        "nav",
        "mixture",
        _run("rooms", "evaluate_rooms"),
        places.table,
        places.headline,
        families=True,
    ),
    Benchmark(
        "scenes",
        "nav",
        "nav",
        _run("scenes", "evaluate_scenes"),
        places.scenes_table,
        places.headline,
        scene_files=True,
    ),
    Benchmark(
        "dynamic",
        "nav",
        "nav",
        _run("dynamic", "evaluate_dynamic"),
        dynamic_report.table,
        dynamic_report.headline,
    ),
    Benchmark(
        "pick", "pick", "tabletop", _run("pick", "evaluate_pick"), pick_report.table, pick_report.headline
    ),
    Benchmark(
        "fetch", "fetch", "fetch", _run("fetch", "evaluate_fetch"), fetch_report.table, fetch_report.headline
    ),
    Benchmark(
        "place",
        "fetch",
        "fetch",
        partial(_run("fetch", "evaluate_fetch"), benchmark="place"),
        fetch_report.place_table,
        report.headline,
    ),
)
BENCHMARKS: Mapping[str, Benchmark] = MappingProxyType({benchmark.name: benchmark for benchmark in _ALL})


def find(name: str | None, task: str, *, families: bool = False) -> Benchmark:
    """Return the benchmark of a name, which measures a task; None takes the first of the task.

    Args:
        name: Its name, or None.
        task: The task.
        families: Whether scenes are of families: then None takes the first for them.

    Raises:
        ConfigError: There is no such benchmark, or it measures another task.
    """
    if name is None:
        own = [b for b in BENCHMARKS.values() if b.task == task and b.families == families]
        if not own:
            raise ConfigError(f"benchmark: there is none of task={task}")
        return own[0]
    if not isinstance(name, str) or name not in BENCHMARKS:
        raise ConfigError(f"benchmark: unknown {short(name)}; choose from {', '.join(BENCHMARKS)}")
    if BENCHMARKS[name].task != task:
        raise ConfigError(f"benchmark: {name} measures task={BENCHMARKS[name].task}, not task={task}")
    return BENCHMARKS[name]
