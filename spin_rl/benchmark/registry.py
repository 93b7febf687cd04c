"""The benchmarks by name: the task that each measures, how it is run, and how its results are told."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

from spin_rl.benchmark.fetch import evaluate_fetch
from spin_rl.benchmark.pick import evaluate_pick
from spin_rl.benchmark.reach import evaluate_reach
from spin_rl.benchmark.tables import fetch as fetch_report
from spin_rl.benchmark.tables import pick as pick_report
from spin_rl.benchmark.tables import reach as report
from spin_rl.config import ConfigError


@dataclass(frozen=True)
class Benchmark:
    """One benchmark.

    Attributes:
        task: The task that it measures, a file in conf/task.
        scene: Its distribution of scenes, a file in conf/scene.
        evaluate: Runs it: policy factory, task configuration, episodes, seeds and device, and by keyword
            `policy_name`, `num_envs` and `announce`, of a fetch also `pick_name`; returns the result.
        table: Formats a result for the terminal.
        headline: One line that sums a result up.
    """

    task: str
    scene: str
    evaluate: Callable[..., dict[str, Any]]
    table: Callable[[dict[str, Any]], str]
    headline: Callable[[dict[str, Any]], str]


BENCHMARKS: Mapping[str, Benchmark] = MappingProxyType(
    {
        "reach": Benchmark("nav", "nav", evaluate_reach, report.table, report.headline),
        "pick": Benchmark("pick", "tabletop", evaluate_pick, pick_report.table, pick_report.headline),
        "fetch": Benchmark("fetch", "fetch", evaluate_fetch, fetch_report.table, fetch_report.headline),
        "place": Benchmark(
            "fetch",
            "fetch",
            partial(evaluate_fetch, benchmark="place"),
            fetch_report.place_table,
            report.headline,
        ),
    }
)


def find(name: str | None, task: str) -> str:
    """Return the name of a benchmark that measures a task; None takes the first there is.

    Raises:
        ConfigError: There is no such benchmark, or it measures another task.
    """
    own = [key for key, benchmark in BENCHMARKS.items() if benchmark.task == task]
    if name is None and own:
        return own[0]
    if name is None:
        raise ConfigError(f"benchmark: there is none of task={task}")
    if name not in BENCHMARKS:
        raise ConfigError(f"benchmark: unknown {name!r}; choose from {', '.join(BENCHMARKS)}")
    if name not in own:
        raise ConfigError(f"benchmark: {name} measures task={BENCHMARKS[name].task}, not task={task}")
    return name
