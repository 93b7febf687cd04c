"""Running the steps of the plan that are missing, some at a time, in processes of their own."""

from __future__ import annotations

import json
import math
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from filelock import FileLock, Timeout

from spin_rl.config import ConfigError
from spin_rl.files import write_json
from spin_rl.machine import num_cores
from spin_rl.reproduce.child import Child, python, started
from spin_rl.reproduce.estimate import duration, minutes_left, time_ahead
from spin_rl.reproduce.plan import Evaluation, Step, Steps, Training, is_alone
from spin_rl.reproduce.record import note_call, stored
from spin_rl.reproduce.state import has_checkpoint, is_done, limits, result_file, state_of, state_of_run
from spin_rl.stop_request import StopRequest

_MOST_JOBS = 2
"""The plan's minutes are those of two at a time."""
_LEAST_MINUTES = 1.0
"""With less time left, no training starts."""
_PATIENCE_S = 120.0
"""What a process that was asked to end may take; it may be compiling kernels."""
_POLL_S = 0.2
_REPORT_S = 180.0
"""Time between lines that tell how far those that run are."""


def default_jobs() -> int:
    """Steps at a time where nobody says how many: one a core, at most two."""
    return min(num_cores(), _MOST_JOBS)


def _say(line: str) -> None:
    print(line, flush=True)


@dataclass
class Runner:
    """Runs steps in their order, each when what it needs is done.

    Attributes:
        steps: All steps.
        jobs: Steps at a time.
        minutes: Limit of all together, or None.
        report: Receives lines of progress.
    """

    steps: Steps
    jobs: int
    minutes: float | None = None
    report: Callable[[str], None] = _say
    _start: float = field(default_factory=time.monotonic)
    _waiting: list[Step] = field(default_factory=list)
    _running: list[Child] = field(default_factory=list)
    _cut_off: list[str] = field(default_factory=list)
    _failures: list[str] = field(default_factory=list)

    def run(self, chosen: Sequence[Step]) -> bool:
        """Run what is not done; return whether all of it is done now.

        A step that fails holds up only those that need it.

        Raises:
            ConfigError: Steps failed; one line that names them and their logs.
            KeyboardInterrupt: The user asked for an end; what was running has saved.
        """
        return self._work([step for step in chosen if not is_done(self.steps, step)])

    def run_again(self, chosen: Sequence[Step]) -> bool:
        """Run as if no result were there: evaluations anew, and trainings whose own run is not whole.

        Returns and raises as `run`.
        """
        return self._work([step for step in chosen if not self._has_own_run(step)], again=True)

    def measure_again(self, chosen: Sequence[Evaluation]) -> None:
        """Run evaluations whose results are there already.

        Raises:
            ConfigError: One failed, or the run of a training is not there any more, or not whole.
            KeyboardInterrupt: The user asked for an end.
        """
        for step in chosen:
            for name in self.steps.needs(step):
                if not self._has_own_run(self.steps.by_name[name]):
                    raise ConfigError(
                        f"fresh: {step.name} needs {self.steps.run_dir(name)}, whole and as planned: "
                        f"{self.steps.command(f'run=true again=true only={step.name}')}"
                    )
        self._work(chosen, again=True)

    def _has_own_run(self, step: Step) -> bool:
        return isinstance(step, Training) and state_of_run(self.steps, step).status == "done"

    def _work(self, todo: Sequence[Step], again: bool = False) -> bool:
        self._waiting = list(todo)
        next_report = time.monotonic() + _REPORT_S
        with StopRequest("as soon as all that runs has saved") as stop, tempfile.TemporaryDirectory() as outs:
            try:
                while stop.name is None and self._minutes_left() > 0.0:
                    self._fill(Path(outs), again)
                    if not self._running:
                        break
                    time.sleep(_POLL_S)
                    for child in [child for child in self._running if child.has_ended()]:
                        self._finish(child)
                    if time.monotonic() > next_report:
                        next_report += _REPORT_S
                        self._tell()
            finally:
                self._end_all()
        if stop.name is not None:
            raise KeyboardInterrupt
        if self._failures:
            raise ConfigError(f"run: {'; '.join(self._failures)}")
        if self._cut_off or self._waiting:
            where = f"in {', '.join(self._cut_off)}" if self._cut_off else f"before {self._waiting[0].name}"
            self.report(f"Stopped by minutes={self.minutes:g} {where}")
        return not (self._cut_off or self._waiting)

    def _minutes_left(self) -> float:
        gone = (time.monotonic() - self._start) / 60.0
        return math.inf if self.minutes is None else self.minutes - gone

    def _fill(self, outs: Path, again: bool) -> None:
        """Start steps as long as there is room; first what has to be alone, where nothing runs."""
        for step in sorted(self._waiting, key=is_alone, reverse=True):
            if len(self._running) >= self.jobs or any(is_alone(child.step) for child in self._running):
                return
            if is_alone(step) and self._running:
                continue
            if step in self._waiting and self._may_start(step):
                self._waiting.remove(step)
                self._begin(step, outs, again)

    def _may_start(self, step: Step) -> bool:
        open_steps = {other.name for other in (*self._waiting, *(child.step for child in self._running))}
        least = _LEAST_MINUTES if isinstance(step, Training) else step.minutes
        return self._minutes_left() >= least and open_steps.isdisjoint(self.steps.needs(step))

    def _begin(self, step: Step, outs: Path, again: bool) -> None:
        """Start a step, unless another call of the command has it or is done with it."""
        log = self.steps.runs / "logs" / f"{step.name}.log"
        log.parent.mkdir(parents=True, exist_ok=True)
        lock = FileLock(log.with_suffix(".lock"))
        try:
            lock.acquire(timeout=0)
        except Timeout:
            self._fail(step, "is run by another call of spin-reproduce")
            return
        if not again and is_done(self.steps, step):
            lock.release()
            self.report(f"{step.name}: done by another call of spin-reproduce")
            return
        expected = minutes_left(self.steps, step)
        out = outs / f"{step.name.replace('/', '-')}.json" if isinstance(step, Evaluation) else None
        try:
            command = self._command(step, out)
        except ConfigError as error:
            lock.release()
            self._fail(step, str(error))
            return
        self._running.append(Child(step, started(command, log), log, lock, out))
        self.report(f"{step.name}: about {expected:.0f} min; {log}")

    def _command(self, step: Step, out: Path | None) -> list[str]:
        """Command line of a step; that of a training is noted beside its run.

        Raises:
            ConfigError: It cannot be run.
        """
        arguments = self.steps.arguments(step)
        if isinstance(step, Evaluation):
            return python(step.command, [*arguments, f"out={out}"])
        run_dir = self.steps.run_dir(step.name)
        if state_of(self.steps, step).status == "outdated":
            raise ConfigError(f"has a run with other arguments than planned; move {run_dir} away")
        arguments += [f"seed={step.seed}", f"run_dir={run_dir}"]
        if has_checkpoint(run_dir):
            arguments = [f"resume={run_dir}"]
        arguments += limits(step)
        note_call(self.steps, step, arguments)
        return python("train", arguments)

    def _finish(self, child: Child, asked: bool = False) -> None:
        """Take note of what a step that has ended leaves behind; `asked` if it was asked to end."""
        self._running.remove(child)
        step, status = child.step, child.process.returncode
        whole = self._keep(step, child) if isinstance(step, Evaluation) else self._has_own_run(step)
        child.lock.release()
        if whole:
            success = state_of(self.steps, step).success
            result = "" if success is None else f", success {success:.2f}"
            self.report(f"{step.name}: done after {child.minutes:.1f} min{result}; {self._ahead()}")
        elif asked:
            self._cut_off.append(step.name)
            self.report(f"{step.name}: ended after {child.minutes:.1f} min: {child.last_line()}")
        else:
            self._fail(step, f"ended with status {status}, see {child.log}: {child.last_line()}")

    def _keep(self, step: Evaluation, child: Child) -> bool:
        """Store what an evaluation has measured; False if it is not whole, as after a request to end."""
        if child.process.returncode or child.out is None or not child.out.exists():
            return False
        result = json.loads(child.out.read_text())
        if result.get("stopped"):
            return False
        write_json(result_file(step.name), stored(self.steps, step, result, child.minutes))
        return True

    def _ahead(self) -> str:
        left = {
            child.step.name: max(0.0, minutes_left(self.steps, child.step) - child.minutes)
            for child in self._running
        }
        left |= {step.name: minutes_left(self.steps, step) for step in self._waiting}
        return f"about {duration(time_ahead(self.steps, left, self.jobs))} for the {len(left)} that are left"

    def _fail(self, step: Step, why: str) -> None:
        """Give a step up, and those that need it."""
        self._failures.append(f"{step.name} {why}")
        given_up = {step.name}
        for other in list(self._waiting):
            if not given_up.isdisjoint(self.steps.needs(other)):
                given_up.add(other.name)
                self._waiting.remove(other)
        self.report(f"{step.name} {why}")
        if len(given_up) > 1:
            self.report(f"  given up with it: {', '.join(sorted(given_up - {step.name}))}")

    def _tell(self) -> None:
        """Tell how far those that run are."""
        for child in self._running:
            if line := child.last_line():
                self.report(f"  {child.step.name}: {line}")

    def _end_all(self) -> None:
        """Ask all that run to end, and wait for that."""
        for child in self._running:
            child.ask_to_end()
        deadline = time.monotonic() + _PATIENCE_S
        for child in list(self._running):
            child.wait(max(0.0, deadline - time.monotonic()))
        for child in list(self._running):
            self._finish(child, asked=True)
