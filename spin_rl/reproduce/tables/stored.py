"""What tables read: results of the plan, all of them or a refusal that says how to make what is missing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from spin_rl.config import ConfigError
from spin_rl.reproduce.plan import PAPER, REACH, Evaluation, Steps
from spin_rl.reproduce.state import read_result, state_of
from spin_rl.reproduce.tables.rates import Rate

Cell = tuple[int, str]


@dataclass(frozen=True)
class Measured:
    """One method of a table: the results of its trainings.

    Attributes:
        name: Name of its trainings without their seeds.
        results: Stored results, one a training.
    """

    name: str
    results: tuple[Mapping[str, Any], ...]

    @property
    def trainings(self) -> list[Mapping[str, Any]]:
        """What is known of each training."""
        return [training for result in self.results for training in result["trainings"]]

    @property
    def steps(self) -> str:
        """Names of the trainings, such as `cvo-1, cvo-2`."""
        return ", ".join(training["name"] for training in self.trainings)

    def rows(self, cell: Cell | None = None) -> list[list[Mapping[str, Any]]]:
        """Rows of a cell of the reach benchmark, or of all, of each training."""
        return [
            [row for row in result["result"]["rows"] if cell in (None, _cell(row))] for result in self.results
        ]

    def rate(self, *cells: Cell) -> Rate:
        """Success in some cells, all trainings together; no cell means all."""
        return Rate.of(row for rows in self._of(cells) for row in rows)

    def rates(self, *cells: Cell) -> list[Rate]:
        """Success in some cells of each training."""
        return [Rate.of(rows) for rows in self._of(cells)]

    def mean(self, key: str, *cells: Cell) -> float | None:
        """Mean of another figure over cells and trainings; None where a row has none.

        `duration_s` is a mean over successes and is weighted by them, the others by episodes.
        """
        total, weight = 0.0, 0.0
        for row in (row for rows in self._of(cells) for row in rows):
            share = row["success_rate"] if key == "duration_s" else 1.0
            if share and row[key] is not None:
                total += share * row["episodes"] * row[key]
                weight += share * row["episodes"]
        return total / weight if weight else None

    def _of(self, cells: tuple[Cell, ...]) -> Iterator[list[Mapping[str, Any]]]:
        for rows in self.rows():
            yield [row for row in rows if not cells or _cell(row) in cells]


def _cell(row: Mapping[str, Any]) -> tuple[Any, Any]:
    """The cell of a row of the reach benchmark, nothing of the others."""
    return row.get("scenario"), row.get("difficulty")


@dataclass
class Stored:
    """The stored results of a plan, for one table.

    Attributes:
        steps: The plan.
        table: Name of the table, for messages.
        used: Steps that were read, in order.
    """

    steps: Steps
    table: str
    used: list[Evaluation] = field(default_factory=list)

    def reach(self, name: str) -> Measured:
        """Results of the reach benchmark of all trainings of a name; see `of_trainings`."""
        return self.of_trainings(REACH, name)

    def of_trainings(self, kind: str, name: str) -> Measured:
        """Results of a kind of all trainings of a name.

        Raises:
            ConfigError: One is missing; one line with the command that makes it.
        """
        found = [
            step
            for step in self.steps.by_name.values()
            if isinstance(step, Evaluation) and step.name.rpartition("-")[0] == f"{kind}/{name}"
        ]
        if not found:
            raise ConfigError(f"table: {self.table} needs trainings {name}, which the plan does not have")
        return Measured(name, tuple(self.result(step.name) for step in found))

    def result(self, name: str) -> Mapping[str, Any]:
        """The stored result of a step.

        Raises:
            ConfigError: It is missing, or of another plan; one line with the command that makes it.
        """
        step = self.steps.by_name.get(name)
        if not isinstance(step, Evaluation):
            raise ConfigError(f"table: {self.table} needs {name}, which the plan does not have")
        status = state_of(self.steps, step).status
        if status != "done":
            what = "there is no" if status == "missing" else "the plan has changed since"
            plan = "" if self.steps.plan == PAPER else f"plan={self.steps.plan} "
            raise ConfigError(
                f"table: {what} result {name}, which {self.table} needs: "
                f"spin-reproduce {plan}run=true only={name}"
            )
        self.used.append(step)
        stored = read_result(name)
        assert stored is not None
        return stored


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
        f"{how} for {_span(steps)} M env steps in {minutes[0]:.0f} to {minutes[-1]:.0f} min, "
        f"processes of each: {_span(processes)}, {'; '.join(machines)}, seeds {_listed(seeds)}, "
        f"commits {commits}"
    )


def episodes_note(methods: list[Measured]) -> str:
    """Say how the trainings were measured."""
    results = [result["result"] for method in methods for result in method.results]
    episodes = sorted({row["episodes"] for result in results for row in result["rows"]})
    seeds = sorted({seed for result in results for seed in result["seeds"]})
    commits = known(result["commit"] for result in results)
    return (
        f"{_span(episodes)} episodes a cell and training, seeds {_listed(seeds)}, "
        f"commits {commits}; "
        "intervals: 95 %, of all trainings of a row together, over corridors and not over trainings"
    )


def known(commits: Iterable[str | None]) -> str:
    """List the commits of the code; a copy that is no checkout knows none."""
    return _listed(sorted({commit or "unknown" for commit in commits}))


def _whole(training: Mapping[str, Any]) -> dict[str, float]:
    """Samples and minutes of a training with those of the trainings that it was started from."""
    parts = [training, *map(_whole, training["needs"])]
    return {key: sum(part[key] for part in parts) for key in ("env_steps", "minutes")}


def _span(values: list[Any]) -> str:
    return f"{values[0]}" if values[0] == values[-1] else f"{values[0]} to {values[-1]}"


def _listed(values: list[Any]) -> str:
    return ", ".join(map(str, values))
