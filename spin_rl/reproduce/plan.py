"""What is to be trained and measured: a file of conf/plan, as steps in order."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from spin_rl.config import ConfigError, Range, from_mapping
from spin_rl.ranges import Seed

REACH = "reach"
"""Kind of results that every training gets unless its group says otherwise."""
PAPER = "paper"
"""Name of the plan that is there without a choice."""

_NAME = re.compile(r"\{([\w-]+)\}")
_EnvSteps = Annotated[int, Range(1, 10**12)]
_PositiveMinutes = Annotated[float, Range(0.0, 1e6, above=True)]


@dataclass(frozen=True)
class Budget:
    """What several trainings get alike.

    Attributes:
        env_steps: Samples, over all processes.
        minutes: What that took where it was measured.
        arguments: Arguments of spin-train before a training's own.
    """

    env_steps: _EnvSteps
    minutes: _PositiveMinutes
    arguments: tuple[str, ...] = ()


@dataclass(frozen=True)
class TrainingEntry:
    """One row of the plan; `seeds` makes a training of each."""

    name: str
    seeds: tuple[Seed, ...]
    budget: str = "drive"
    arguments: tuple[str, ...] = ()
    evaluate: bool = True


@dataclass(frozen=True)
class EvaluationEntry:
    """A further measurement.

    Attributes:
        kind: A folder of the results.
        name: Its file there.
        arguments: Of the command.
        command: What comes after `spin-`.
        minutes: What it takes.
        alone: Whether nothing may run beside it, as where speed is measured.
    """

    kind: str
    name: str
    arguments: tuple[str, ...]
    command: str = "eval"
    minutes: _PositiveMinutes = 4.0
    alone: bool = False


@dataclass(frozen=True)
class Measure:
    """How the trainings of a group are measured; `kind` is a folder of the results."""

    kind: str = REACH
    arguments: tuple[str, ...] = (f"benchmark={REACH}",)
    minutes: _PositiveMinutes = 4.0


@dataclass(frozen=True)
class Group:
    """Trainings and evaluations that carry a claim."""

    name: str
    claim: str
    measure: Measure = field(default_factory=Measure)
    trainings: tuple[TrainingEntry, ...] = ()
    evaluations: tuple[EvaluationEntry, ...] = ()


@dataclass(frozen=True)
class Plan:
    """The file; `name` is its own."""

    budgets: dict[str, Any]
    groups: tuple[Any, ...]
    name: str = PAPER


@dataclass(frozen=True)
class Training:
    """A training run.

    Attributes:
        name: Such as `cvo-1`, also the run's folder.
        arguments: Of spin-train; `{name}` in them is the run of another training.
        seed: Its seed.
        env_steps: Its samples.
        minutes: What they took where that was measured.
        claim: What it is for.
        group: Name of its group.
    """

    name: str
    arguments: tuple[str, ...]
    seed: int
    env_steps: int
    minutes: float
    claim: str
    group: str


@dataclass(frozen=True)
class Evaluation:
    """A measurement whose result is kept; `name` is `<kind>/<what>`, also its file among the results."""

    name: str
    command: str
    arguments: tuple[str, ...]
    minutes: float
    claim: str
    group: str
    alone: bool = False


Step = Training | Evaluation


def is_alone(step: Step) -> bool:
    """Whether nothing may run beside a step."""
    return isinstance(step, Evaluation) and step.alone


@dataclass(frozen=True)
class Steps:
    """All steps in order.

    Attributes:
        by_name: The steps; what one needs comes before it.
        runs: Folder of the runs.
        plan: Name of the plan.
    """

    by_name: dict[str, Step]
    runs: Path = field(default=Path("runs/reproduce"))
    plan: str = PAPER

    def run_dir(self, training: str) -> Path:
        """Folder of a training's run."""
        return self.runs / training

    def command(self, rest: str) -> str:
        """Command line of spin-reproduce for this plan."""
        plan = "" if self.plan == PAPER else f"plan={self.plan} "
        return f"spin-reproduce {plan}{rest}"

    def needs(self, step: Step) -> list[str]:
        """Name the trainings that a step needs."""
        return [name for argument in step.arguments for name in _NAME.findall(argument)]

    def arguments(self, step: Step) -> list[str]:
        """Arguments of a step with the folders of the runs that it needs."""
        return [_NAME.sub(lambda match: str(self.run_dir(match[1])), given) for given in step.arguments]

    def chosen(self, parts: Sequence[str] | None) -> list[Step]:
        """Return the steps of some names, or with one of some parts in theirs, and what they need, in order.

        Raises:
            ConfigError: There is none with one of the parts.
        """
        if parts is None:
            return list(self.by_name.values())
        names: set[str] = set()
        for part in parts:
            fitting = [part] if part in self.by_name else [name for name in self.by_name if part in name]
            if not fitting:
                raise ConfigError(f"only: no step has {part!r} in its name; spin-reproduce lists them")
            names |= set(fitting)
        wanted: set[str] = set()
        while names:
            name = names.pop()
            wanted.add(name)
            names |= set(self.needs(self.by_name[name])) - wanted
        return [step for name, step in self.by_name.items() if name in wanted]


def read_steps(values: Mapping[str, Any], runs: Path = Path("runs/reproduce")) -> Steps:
    """Read the plan.

    Args:
        values: The file's, nested.
        runs: Folder of the runs.

    Raises:
        ConfigError: One line that names the key.
    """
    plan = from_mapping(Plan, values, "plan")
    budgets = {
        name: from_mapping(Budget, given, f"plan.budgets.{name}") for name, given in plan.budgets.items()
    }
    steps: dict[str, Step] = {}
    for number, given in enumerate(plan.groups):
        where = f"plan.groups[{number}]"
        for step in _steps_of(_group(given, where), budgets, where):
            if step.name in steps:
                raise ConfigError(f"{where}: {step.name} is there twice")
            steps[step.name] = step
    result = Steps(steps, runs, plan.name)
    before: set[str] = set()
    for step in steps.values():
        for name in result.needs(step):
            if name not in before or not isinstance(steps[name], Training):
                raise ConfigError(f"plan: {step.name} needs the training {name} before it")
        before.add(step.name)
    return result


def _group(given: Mapping[str, Any], where: str) -> Group:
    parts = {"trainings": TrainingEntry, "evaluations": EvaluationEntry}
    entries = {
        key: tuple(
            from_mapping(kind, entry, f"{where}.{key}[{i}]") for i, entry in enumerate(given.get(key) or ())
        )
        for key, kind in parts.items()
    }
    return from_mapping(Group, {**given, **entries}, where)


def _steps_of(group: Group, budgets: Mapping[str, Budget], where: str) -> Iterable[Step]:
    """Trainings first, then what measures them: evaluations run side by side."""
    trainings: list[Training] = []
    measured: list[str] = []
    for entry in group.trainings:
        if entry.budget not in budgets:
            raise ConfigError(f"{where}: unknown budget {entry.budget!r}; choose from {', '.join(budgets)}")
        budget = budgets[entry.budget]
        for seed in entry.seeds:
            arguments = tuple(_of_seed(given, seed) for given in (*budget.arguments, *entry.arguments))
            name = f"{entry.name}-{seed}"
            trainings.append(
                Training(name, arguments, seed, budget.env_steps, budget.minutes, group.claim, group.name)
            )
            measured += [name] if entry.evaluate else []
    yield from trainings
    for name in measured:
        measure = group.measure
        arguments = (f"policy={{{name}}}", *measure.arguments)
        yield Evaluation(
            f"{measure.kind}/{name}", "eval", arguments, measure.minutes, group.claim, group.name
        )
    for entry in group.evaluations:
        yield Evaluation(
            f"{entry.kind}/{entry.name}",
            entry.command,
            entry.arguments,
            entry.minutes,
            group.claim,
            group.name,
            entry.alone,
        )


def _of_seed(argument: str, seed: int) -> str:
    return _NAME.sub(lambda match: f"{{{match[1]}-{seed}}}", argument)
