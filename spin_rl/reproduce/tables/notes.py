"""What tables say of how they were made: budgets, episodes, intervals, machines, code and commands."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from spin_rl.reproduce.tables.stored import Measured

COMMANDS = (
    "a row again: `spin-reproduce run=true again=true only=reach/<training>`; the commands of its training "
    "and of its measurement are in `results/reach/<training>.json`"
)

INTERVALS = (
    "over scenes and not over trainings: Wilson's, with as many episodes as are independent, and of "
    "differences in the same scenes Bonett and Price's"
)


def budget_note(methods: list[Measured], how: str = "trained from scratch") -> str:
    """Say what trainings had alike: samples, time, processes, machines and code; `how` they were trained."""
    trainings = [training for method in methods for training in method.trainings]
    whole = [_whole(training) for training in trainings]
    steps = sorted({round(facts["env_steps"] / 1e6, 1) for facts in whole})
    minutes = sorted(facts["minutes"] for facts in whole)
    processes = sorted({training["processes"] for training in trainings})
    machines = sorted({training["hardware"] for training in trainings})
    commits = known(commit for training in trainings for commit in training["commits"])
    seeds = sorted({training["seed"] for training in trainings})
    return (
        f"{how} for {span(steps)} M env steps in {minutes[0]:.0f} to {minutes[-1]:.0f} min, "
        f"processes of each: {span(processes)}, {'; '.join(machines)}, seeds {_listed(seeds)}, "
        f"commits {commits}"
    )


def episodes_note(methods: list[Measured]) -> str:
    """Say how the trainings were measured."""
    results = [result["result"] for method in methods for result in method.results]
    episodes = sorted({row["episodes"] for result in results for row in result["rows"]})
    seeds = sorted({seed for result in results for seed in result["seeds"]})
    commits = known(result["commit"] for result in results)
    return (
        f"{span(episodes)} episodes a cell and training, seeds {_listed(seeds)}, "
        f"commits {commits}; "
        f"intervals: 95 %, of all trainings of a row, {INTERVALS}"
    )


def known(commits: Iterable[str | None]) -> str:
    """List the commits of the code; a copy that is no checkout knows none."""
    return _listed(sorted({commit or "unknown" for commit in commits}))


def _whole(training: Mapping[str, Any]) -> dict[str, float]:
    """Samples and minutes of a training with those of the trainings that it was started from."""
    parts = [training, *map(_whole, training["needs"])]
    return {key: sum(part[key] for part in parts) for key in ("env_steps", "minutes")}


def span(values: list[Any]) -> str:
    """From the first to the last of sorted values."""
    return f"{values[0]}" if values[0] == values[-1] else f"{values[0]} to {values[-1]}"


def _listed(values: list[Any]) -> str:
    return ", ".join(map(str, values))
