"""Running the steps of the plan that are missing, in processes of their own."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from spin_rl.config import ConfigError
from spin_rl.files import write_json
from spin_rl.machine import commit, hardware
from spin_rl.reproduce.curve import read_curve
from spin_rl.reproduce.listing import duration
from spin_rl.reproduce.plan import Evaluation, Step, Steps, Training
from spin_rl.reproduce.state import (
    command_of,
    has_checkpoint,
    is_done,
    planned,
    result_file,
)
from spin_rl.tasks.common.compose import compose

_TOOLS = {"train": "train", "eval": "evaluate", "bench": "bench"}
"""Name of a command after `spin-` -> its module in spin_rl.cli."""
_LEAST_MINUTES = 1.0
"""With less time left, no training starts."""
_PATIENCE_S = 120.0
"""What a process that was asked to end may take."""


@dataclass
class Runner:
    """Runs steps: several evaluations at a time, and one training, or several of one process.

    Attributes:
        steps: All steps.
        processes: All that run at a time.
        minutes: Limit of all together, or None.
        report: Receives lines of progress.
    """

    steps: Steps
    processes: int
    minutes: float | None = None
    report: Callable[[str], None] = print
    _start: float = field(default_factory=time.monotonic)

    def run(self, chosen: Sequence[Step]) -> bool:
        """Run what is not done; return whether all of it is done now.

        Raises:
            ConfigError: A step failed; one line that names it and, if it has one, its log.
            KeyboardInterrupt: The user asked for an end; what was running has saved.
        """
        todo = [step for step in chosen if not is_done(self.steps, step)]
        while todo:
            count = self._number_side_by_side(todo)
            batch, todo = todo[:count], todo[count:]
            expected = max(step.minutes for step in batch)
            left = self._minutes_left()
            if left < (_LEAST_MINUTES if isinstance(batch[0], Training) else expected):
                self.report(f"Stopped by minutes={self.minutes:g} before {batch[0].name}")
                return False
            ahead = sum(
                step.minutes / self.steps.side_by_side(step, self.processes) for step in (*batch, *todo)
            )
            self.report(
                f"{', '.join(step.name for step in batch)}: about {expected:.0f} min; "
                f"about {duration(ahead)} for all that is left"
            )
            start = time.monotonic()
            if isinstance(batch[0], Training):
                self._train([step for step in batch if isinstance(step, Training)], left)
                cut_off = [step.name for step in batch if not is_done(self.steps, step)]
                if cut_off:
                    self.report(f"Stopped by minutes={self.minutes:g} in {', '.join(cut_off)}")
                    return False
            else:
                self._measure([step for step in batch if isinstance(step, Evaluation)])
            self.report(f"  done after {(time.monotonic() - start) / 60:.1f} min")
        return True

    def _number_side_by_side(self, todo: Sequence[Step]) -> int:
        """How many of the next steps run together: as many alike in a row as there are processes for."""
        most = min(self.steps.side_by_side(todo[0], self.processes), len(todo))
        count = 1
        while count < most and type(todo[count]) is type(todo[0]):
            if {step.name for step in todo[:count]} & set(self.steps.needs(todo[count])):
                break
            count += 1
        return count

    def measure_again(self, chosen: Sequence[Evaluation]) -> None:
        """Run evaluations whose results are there already.

        Raises:
            ConfigError: One failed, or the run of a training is not there any more.
        """
        for step in chosen:
            for name in self.steps.needs(step):
                if not has_checkpoint(self.steps.run_dir(name)):
                    raise ConfigError(f"fresh: {step.name} needs the run {self.steps.run_dir(name)}")
        for first in range(0, len(chosen), self.processes):
            batch = chosen[first : first + self.processes]
            self.report(f"{', '.join(step.name for step in batch)}: about {batch[0].minutes:.0f} min")
            self._measure(batch)

    def _minutes_left(self) -> float:
        gone = (time.monotonic() - self._start) / 60.0
        return math.inf if self.minutes is None else self.minutes - gone

    def _train(self, batch: Sequence[Training], minutes_left: float) -> None:
        """Start or resume trainings and wait for them; one alone writes to the terminal."""
        count = self.steps.processes or self.processes
        minutes = "null" if math.isinf(minutes_left) else f"{minutes_left:.2f}"
        processes = []
        for step in batch:
            run_dir = self.steps.run_dir(step.name)
            limits = [f"max_iterations={iterations(self.steps, step, count)}", f"max_minutes={minutes}"]
            if has_checkpoint(run_dir):
                arguments = [f"resume={run_dir}", *limits]
            else:
                arguments = [*self.steps.arguments(step), f"seed={step.seed}", f"run_dir={run_dir}", *limits]
            note_call(run_dir, arguments)
            log = None if len(batch) == 1 else self._log(step)
            processes.append(_started(_python("train", arguments, count), log))
        _wait(processes, [step.name if len(batch) == 1 else self._named(step) for step in batch])

    def _log(self, step: Step) -> Path:
        return self.steps.runs / "logs" / f"{step.name.replace('/', '-')}.log"

    def _named(self, step: Step) -> str:
        return f"{step.name} (see {self._log(step)})"

    def _measure(self, batch: Sequence[Evaluation]) -> None:
        with tempfile.TemporaryDirectory() as folder:
            outs = [Path(folder) / f"{i}.json" for i in range(len(batch))]
            start = time.monotonic()
            processes = []
            for step, out in zip(batch, outs, strict=True):
                arguments = [*self.steps.arguments(step), f"out={out}"]
                processes.append(_started(_python(step.command, arguments), self._log(step)))
            _wait(processes, [self._named(step) for step in batch])
            minutes = (time.monotonic() - start) / 60.0
            for step, out in zip(batch, outs, strict=True):
                write_json(
                    result_file(step.name), stored(self.steps, step, json.loads(out.read_text()), minutes)
                )


def iterations(steps: Steps, step: Training, processes: int) -> int:
    """Iterations after which a training has its samples."""
    values = compose("train", steps.arguments(step))
    per_iteration = values["num_envs"] * values["runner"]["num_steps_per_env"] * processes
    return math.ceil(step.env_steps / per_iteration)


def stored(steps: Steps, step: Evaluation, result: dict[str, Any], minutes: float) -> dict[str, Any]:
    """Put a result together with what it was made of and where.

    Args:
        steps: All steps.
        step: The one that it is of.
        result: What the command wrote.
        minutes: What it took.
    """
    trainings = [steps.by_name[name] for name in steps.needs(step)]
    return {
        "command": command_of(steps, step),
        "step": planned(step),
        "commit": commit(),
        "hardware": hardware(result.get("device", "cpu")),
        "minutes": round(minutes, 2),
        "trainings": [describe(steps, training) for training in trainings if isinstance(training, Training)],
        "result": result,
    }


def describe(steps: Steps, step: Training) -> dict[str, Any]:
    """What a result tells of the training that made its policy: command, samples, time, machine and code."""
    run_dir = steps.run_dir(step.name)
    summary = json.loads((run_dir / "summary.json").read_text())
    calls = [json.loads(line) for line in _calls_file(run_dir).read_text().splitlines()]
    kept = ("env_steps", "minutes", "success_rate", "processes")
    return {
        **planned(step),
        "command": command_of(steps, step),
        **{key: summary[key] for key in kept},
        "commits": list(dict.fromkeys(call["commit"] for call in calls)),
        "hardware": calls[-1]["hardware"],
        "curve": read_curve(run_dir),
        "needs": [
            describe(steps, other)
            for other in (steps.by_name[name] for name in steps.needs(step))
            if isinstance(other, Training)
        ],
    }


def note_call(run_dir: Path, arguments: Sequence[str]) -> None:
    """Add a line to the run's list of the calls that made it, with commit and machine."""
    file = _calls_file(run_dir)
    file.parent.mkdir(parents=True, exist_ok=True)
    call = {"arguments": list(arguments), "commit": commit(), "hardware": hardware("cpu")}
    with open(file, "a") as lines:
        lines.write(json.dumps(call) + "\n")


def _calls_file(run_dir: Path) -> Path:
    return run_dir / "calls.jsonl"


def _python(tool: str, arguments: Sequence[str], processes: int = 1) -> list[str]:
    launcher = ["-m", "torch.distributed.run", "--standalone", f"--nproc-per-node={processes}"]
    return [
        sys.executable,
        *(launcher if processes > 1 else []),
        "-m",
        f"spin_rl.cli.{_TOOLS[tool]}",
        *arguments,
    ]


def _started(command: Sequence[str], log: Path | None = None) -> subprocess.Popen[bytes]:
    """Start a process in a session of its own, so that it gets a Ctrl-C once, from us."""
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    if log is None:
        return subprocess.Popen(command, env=environment, start_new_session=True)
    log.parent.mkdir(parents=True, exist_ok=True)
    with open(log, "wb") as output:
        return subprocess.Popen(
            command, env=environment, start_new_session=True, stdout=output, stderr=subprocess.STDOUT
        )


def _wait(processes: Sequence[subprocess.Popen[bytes]], names: Sequence[str]) -> None:
    """Wait until all have ended; on Ctrl-C or SIGTERM ask them to end and wait for that.

    Raises:
        ConfigError: One of them failed.
    """
    try:
        codes = [process.wait() for process in processes]
    except KeyboardInterrupt:
        for process in processes:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
        for process in processes:
            process.wait(timeout=_PATIENCE_S)
        raise
    for code, name in zip(codes, names, strict=True):
        if code:
            raise ConfigError(f"run: {name} ended with status {code}")
