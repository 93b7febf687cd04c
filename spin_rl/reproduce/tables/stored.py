"""What tables read: the results of the plan that are there, and how to make those that are missing."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from spin_rl.config import ConfigError
from spin_rl.reproduce.plan import REACH, Evaluation, Steps
from spin_rl.reproduce.state import damage_of, read_result, state_of_result
from spin_rl.reproduce.tables.missing import Missing
from spin_rl.reproduce.tables.rates import Rate

Cell = tuple[int, str]
Label = TypeVar("Label")


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
        """Success of the trainings in some cells; no cell means all."""
        return Rate.of(self._of(cells))

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

    def final_distance(self) -> tuple[float, float, float]:
        """Mean distance to the goal at the end [m] over cells and trainings, and its 95 % interval.

        The half widths of the cells' own intervals are added as errors that are independent, but for those of
        trainings in one cell: they have the same scenes.
        """
        by_training = self.rows()
        rows = [row for rows in by_training for row in rows]
        mean = sum(row["final_distance_m"] for row in rows) / len(rows)
        halves = [
            [(high - low) / 2.0 for low, high in (row["final_distance_ci95"] for row in rows)]
            for rows in by_training
        ]
        of_cells = [sum(cell) / len(cell) for cell in zip(*halves, strict=True)]
        half = math.hypot(*of_cells) / len(of_cells)
        return mean, mean - half, mean + half

    def _of(self, cells: tuple[Cell, ...]) -> Iterator[list[Mapping[str, Any]]]:
        for rows in self.rows():
            yield [row for row in rows if not cells or _cell(row) in cells]


def _cell(row: Mapping[str, Any]) -> tuple[Any, Any]:
    """The cell of a row of the reach benchmark, nothing of the others."""
    return row.get("scenario"), row.get("difficulty")


_PLACES = ("family", "scene", "obstacles", "scenario", "difficulty")
"""Keys of rows that name where their episodes were."""


_CONDITIONS = ("seeds", "num_envs", "sim", "robot", "noise", "goal_tolerance_m")
"""What must be the same in results that are compared."""


def refuse_other_scenes(what: str, results: Iterable[Mapping[str, Any]]) -> None:
    """Refuse to compare results that were not measured in the same scenes.

    Args:
        what: They are of, for the message.
        results: Stored ones.

    Raises:
        ConfigError: Seeds, episodes, places, numbers of worlds, physics, robot, noise or tolerance differ.
    """
    scenes = {
        (
            tuple((row["episodes"], *map(row.get, _PLACES)) for row in facts["rows"]),
            json.dumps({key: facts.get(key) for key in _CONDITIONS}, sort_keys=True),
        )
        for facts in (result["result"] for result in results)
    }
    if len(scenes) > 1:
        raise ConfigError(f"table: {what} were measured in other scenes: run them again")


class NothingStored(ConfigError):
    """What a table cannot do without is not there yet; one line with the command that makes it."""


@dataclass
class Stored:
    """The stored results of a plan, for one table.

    Attributes:
        steps: The plan.
        table: Name of the table, for messages.
        used: Steps that were read, in order.
        missing: Those whose result is not there, or of another plan.
    """

    steps: Steps
    table: str
    used: list[Evaluation] = field(default_factory=list)
    missing: list[Evaluation] = field(default_factory=list)

    def reach(self, names: Mapping[Label, str]) -> dict[Label, Measured]:
        """Results of the reach benchmark by label, of those trainings that have one; see `measured`."""
        found = {label: self.measured(REACH, name) for label, name in names.items()}
        refuse_other_scenes("rows", (result for method in found.values() for result in method.results))
        return {label: method for label, method in found.items() if method.results}

    def measured(self, kind: str, name: str) -> Measured:
        """Results of a kind of those trainings of a name that have one; the others are noted as missing.

        Raises:
            ConfigError: The plan does not have such trainings, or a result is damaged.
        """
        found = [
            step
            for step in self.steps.by_name.values()
            if isinstance(step, Evaluation) and step.name.rpartition("-")[0] == f"{kind}/{name}"
        ]
        if not found:
            raise ConfigError(f"table: {self.table} needs trainings {name}, which the plan does not have")
        results = [self.find(step.name) for step in found]
        return Measured(name, tuple(result for result in results if result is not None))

    def of_trainings(self, kind: str, name: str) -> Measured:
        """Results of a kind of all trainings of a name.

        Raises:
            NothingStored: One is missing.
        """
        measured = self.measured(kind, name)
        self.refuse_missing()
        return measured

    def result(self, name: str) -> Mapping[str, Any]:
        """The stored result of a step.

        Raises:
            NothingStored: It is missing.
        """
        found = self.find(name)
        self.refuse_missing()
        assert found is not None
        return found

    def find(self, name: str) -> Mapping[str, Any] | None:
        """The stored result of a step; None, and noted as missing, where there is none of this plan.

        Raises:
            ConfigError: The plan does not have it, or it is damaged.
        """
        step = self.steps.by_name.get(name)
        if not isinstance(step, Evaluation):
            raise ConfigError(f"table: {self.table} needs {name}, which the plan does not have")
        if state_of_result(self.steps, step).status != "done":
            if damage := damage_of(name):
                again = Missing.of(self.steps, [step]).command
                raise ConfigError(f"table: {damage}, which {self.table} reads; measure it again: {again}")
            self.missing.append(step)
            return None
        if step not in self.used:
            self.used.append(step)
        return read_result(name)

    def refuse_missing(self) -> None:
        """Refuse a table of which something is missing.

        Raises:
            NothingStored: Something is.
        """
        if self.missing:
            raise NothingStored(f"table: {self.table}: {Missing.of(self.steps, self.missing).line()}")

    def refuse_empty(self) -> None:
        """Refuse a table of which nothing is there.

        Raises:
            NothingStored: Nothing is.
        """
        if not self.used:
            self.refuse_missing()

    @property
    def rest(self) -> Missing | None:
        """What a table says of its missing results; None where all are there."""
        return Missing.of(self.steps, self.missing) if self.missing else None
