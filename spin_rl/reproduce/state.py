"""What of the plan is done, as the runs and the results tell."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

from spin_rl.config import ConfigError
from spin_rl.paths import RESULT_DIR
from spin_rl.reproduce.contents import lacking
from spin_rl.reproduce.plan import Evaluation, Step, Steps, Training
from spin_rl.tasks.common.compose import compose

_OF_RUN = ("env_steps", "minutes", "success_rate")
"""What a result keeps of a training's summary, by which the run is known."""
Status = Literal["done", "partial", "missing", "outdated"]


@dataclass(frozen=True)
class State:
    """How far a step has come.

    Attributes:
        status: "partial" is a training that was interrupted, "outdated" a run or a result of something else
            than is planned now.
        minutes: What it took so far; None where that is not known.
        env_steps: Samples of a training so far.
        success: Success rate of a training at its end, of a result its mean over the rows.
    """

    status: Status
    minutes: float | None = None
    env_steps: int | None = None
    success: float | None = None


def result_file(name: str) -> Path:
    """File of a result, such as `reach/cvo-1`."""
    return RESULT_DIR / f"{name}.json"


def read_result(name: str) -> dict[str, Any] | None:
    """Return a stored result; None where there is none, or none that is whole."""
    stored = _read(result_file(name))
    return None if lacking(name, stored) else stored


def damage_of(name: str) -> str | None:
    """Say in a line what is wrong with the file of a result; None where it is whole, or not there."""
    file = result_file(name)
    if not file.exists() or read_result(name) is not None:
        return None
    stored = _read(file)
    return f"{file} is no whole JSON" if stored is None else f"{file} lacks {lacking(name, stored)}"


def state_of(steps: Steps, step: Step) -> State:
    """Find out how far a step has come."""
    return _of_training(steps, step) if isinstance(step, Training) else _of_evaluation(steps, step)


def is_done(steps: Steps, step: Step) -> bool:
    """Whether nothing is left to do for a step."""
    return state_of(steps, step).status == "done"


def has_checkpoint(run_dir: Path) -> bool:
    """Whether a run can go on."""
    return any((run_dir / "checkpoints").glob("*.pt"))


def calls_file(run_dir: Path) -> Path:
    """File of a run with a line for each call that made it."""
    return run_dir / "calls.jsonl"


def read_calls(run_dir: Path) -> list[dict[str, Any]]:
    """The calls that made a run, in order; none where nothing was noted.

    Raises:
        ConfigError: The file is damaged; one line that names it.
    """
    file = calls_file(run_dir)
    try:
        return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    except ValueError:
        raise ConfigError(f"{file} is damaged: move {run_dir} away, or choose another runs=") from None


def planned(step: Step) -> dict[str, Any]:
    """What a result keeps of a step, by which it is found to be of another plan."""
    facts: dict[str, Any] = {"name": step.name, "arguments": list(step.arguments)}
    if isinstance(step, Training):
        return facts | {"seed": step.seed, "planned_env_steps": step.env_steps}
    return facts | {"tool": step.command}


def command_of(steps: Steps, step: Step) -> str:
    """The command line of a step as a user would type it."""
    given = steps.arguments(step)
    if isinstance(step, Training):
        given += [f"seed={step.seed}", f"run_dir={steps.run_dir(step.name)}", *limits(step)]
    tool = "train" if isinstance(step, Training) else step.command
    return " ".join([f"spin-{tool}", *map(_quoted, given)])


def limits(step: Training) -> list[str]:
    """Arguments that end a training with its samples.

    There is no limit of time: schedules of the learning would go by it.
    """
    # A composition takes a tenth of a second; a dotted key changes nothing but itself, and weights no sizes.
    that_matter = tuple(
        argument
        for argument in step.arguments
        if "." not in (key := argument.partition("=")[0]) or key == "runner.num_steps_per_env"
        if key not in ("init", "teacher")
    )
    return [f"max_iterations={iterations(that_matter, step.env_steps)}", "max_minutes=null"]


@lru_cache
def iterations(arguments: tuple[str, ...], env_steps: int) -> int:
    """Iterations after which a training with some arguments has its samples."""
    values = compose("train", list(arguments))
    return math.ceil(env_steps / (values["num_envs"] * values["runner"]["num_steps_per_env"]))


def state_of_run(steps: Steps, step: Training) -> State:
    """Find out how far the run of a training has come, whatever results are there.

    Raises:
        ConfigError: What the run tells of itself is damaged; one line that names the file.
    """
    run_dir = steps.run_dir(step.name)
    summary = _summary(run_dir)
    if (summary is not None or has_checkpoint(run_dir)) and not _is_planned(run_dir, step):
        return State("outdated")
    if summary is not None:
        status = "done" if summary["env_steps"] >= step.env_steps else "partial"
        return State(status, summary["minutes"], summary["env_steps"], summary["success_rate"])
    return State("partial" if has_checkpoint(run_dir) else "missing")


def _of_training(steps: Steps, step: Training) -> State:
    run = state_of_run(steps, step)
    if run.status != "missing":
        return run
    # Its run may be gone, or on another machine: nothing needs it where all that was made of it is there.
    users = [other for other in steps.by_name.values() if step.name in steps.needs(other)]
    if not users or not all(is_done(steps, user) for user in users):
        return State("missing")
    kept = next((fact for user in users for fact in _trainings(user) if fact["name"] == step.name), {})
    return State("done", kept.get("minutes"), kept.get("env_steps"), kept.get("success_rate"))


def _is_planned(run_dir: Path, step: Training) -> bool:
    """Whether a run was made with the arguments and the seed of the plan; with other samples it can go on.

    One of which nobody noted how it was made is none of the plan's.
    """
    calls = read_calls(run_dir)
    noted = calls[-1].get("step") if calls else None
    return noted is not None and _agrees(noted | {"planned_env_steps": step.env_steps}, step)


def _of_evaluation(steps: Steps, step: Evaluation) -> State:
    state = state_of_result(steps, step)
    are_of_runs = all(_is_of_run(steps.run_dir(fact["name"]), fact) for fact in _trainings(step))
    return state if are_of_runs else replace(state, status="outdated")


def state_of_result(steps: Steps, step: Evaluation) -> State:
    """Find out whether a result is there and of this plan, whatever runs are there."""
    stored = read_result(step.name)
    if stored is None:
        return State("missing")
    same = _agrees(stored["step"], step) and _has_trainings(steps, step, stored["trainings"])
    rates = [row["success_rate"] for row in stored["result"].get("rows", ()) if "success_rate" in row]
    success = sum(rates) / len(rates) if rates else None
    return State("done" if same else "outdated", stored["minutes"], success=success)


def _agrees(kept: Mapping[str, Any], step: Step) -> bool:
    return {key: kept.get(key) for key in planned(step)} == planned(step)


def _has_trainings(steps: Steps, step: Step, trainings: Sequence[Mapping[str, Any]]) -> bool:
    """Whether what a step needs, and what that needs, was trained as planned."""
    known = {fact["name"]: fact for fact in trainings}
    return all(
        name in known
        and _agrees(known[name], steps.by_name[name])
        and _has_trainings(steps, steps.by_name[name], known[name]["needs"])
        for name in steps.needs(step)
    )


def _is_of_run(run_dir: Path, training: Mapping[str, Any]) -> bool:
    """Whether a result is of the run that is there, if one is: a new training asks for new measurements."""
    summary = _summary(run_dir)
    return summary is None or all(summary[key] == training[key] for key in _OF_RUN)


def _summary(run_dir: Path) -> dict[str, Any] | None:
    """What a whole run tells of itself; None where there is none yet."""
    file = run_dir / "summary.json"
    summary = _read(file)
    if file.exists() and not set(_OF_RUN) <= set(summary or ()):
        raise ConfigError(f"{file} is damaged: move {run_dir} away, or choose another runs=")
    return summary


def _trainings(step: Step) -> list[dict[str, Any]]:
    stored = read_result(step.name) if isinstance(step, Evaluation) else None
    return [] if stored is None else stored["trainings"]


def _read(path: Path) -> dict[str, Any] | None:
    try:
        values = json.loads(path.read_text())
    except (OSError, ValueError):
        return None
    return values if isinstance(values, dict) else None


def _quoted(argument: str) -> str:
    return f"'{argument}'" if set("[]{}()* ") & set(argument) else argument
