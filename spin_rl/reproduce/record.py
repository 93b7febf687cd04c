"""What is kept of a step: the calls that made a run, and a result with all that it was made of."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from spin_rl.machine import commit, hardware
from spin_rl.reproduce.curve import read_curve
from spin_rl.reproduce.plan import Evaluation, Step, Steps, Training
from spin_rl.reproduce.state import calls_file, command_of, planned, read_calls


def stored(steps: Steps, step: Evaluation, result: dict[str, Any], minutes: float) -> dict[str, Any]:
    """Put a result together with what it was made of and where.

    Args:
        steps: All steps.
        step: The one that it is of.
        result: What the command wrote.
        minutes: What it took.
    """
    return {
        "command": command_of(steps, step),
        "step": planned(step),
        "commit": commit(),
        "hardware": hardware(result.get("device", "cpu")),
        "minutes": round(minutes, 2),
        "trainings": _needed(steps, step),
        "result": result,
    }


def describe(steps: Steps, step: Training) -> dict[str, Any]:
    """What a result tells of the training that made its policy: command, samples, time, machine and code."""
    run_dir = steps.run_dir(step.name)
    summary = json.loads((run_dir / "summary.json").read_text())
    calls = read_calls(run_dir)
    kept = ("env_steps", "minutes", "success_rate", "processes")
    return {
        **planned(step),
        "command": command_of(steps, step),
        **{key: summary[key] for key in kept},
        "commits": list(dict.fromkeys(call["commit"] for call in calls)),
        "hardware": calls[-1]["hardware"],
        "curve": read_curve(run_dir),
        "needs": calls[0].get("needs") or _needed(steps, step),
    }


def _needed(steps: Steps, step: Step) -> list[dict[str, Any]]:
    needed = [steps.by_name[name] for name in steps.needs(step)]
    return [describe(steps, training) for training in needed if isinstance(training, Training)]


def note_call(steps: Steps, step: Training, arguments: Sequence[str]) -> None:
    """Add a line to the run's list of the calls that made it, with what was planned, commit and machine."""
    file = calls_file(steps.run_dir(step.name))
    before = read_calls(steps.run_dir(step.name))
    file.parent.mkdir(parents=True, exist_ok=True)
    call = {
        "step": planned(step),
        "arguments": list(arguments),
        "commit": commit(),
        "hardware": hardware("cpu"),
        # Of the begin: the runs that it was started from may be gone later.
        "needs": [] if before else _needed(steps, step),
    }
    with open(file, "a") as lines:
        lines.write(json.dumps(call) + "\n")
