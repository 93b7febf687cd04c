"""spin-reproduce: list and run all trainings and evaluations of the comparison with the paper."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from spin_rl.cli import common
from spin_rl.config import ConfigError, Range, from_keys
from spin_rl.ranges import Minutes
from spin_rl.reproduce.listing import progress
from spin_rl.reproduce.plan import read_steps
from spin_rl.reproduce.run import Runner, default_jobs


@dataclass(frozen=True)
class Options:
    """What to list or run, checked; see conf/reproduce.yaml."""

    run: bool
    again: bool
    only: tuple[str, ...] | None
    minutes: Minutes | None
    jobs: Annotated[int, Range(1, 1024)] | None
    runs: Path
    plan: dict[str, Any]


def main() -> None:
    """Entry point of the `spin-reproduce` command."""
    common.run("reproduce", reproduce, lambda given: (given, None), common.keys_of(Options, ()))


def reproduce(call: common.Call) -> bool:
    """List the steps or run those that are missing.

    Raises:
        ConfigError: One line that names the key, or the step that failed.
    """
    options = read_options(call.values)
    steps = read_steps(options.plan, options.runs)
    chosen = steps.chosen(options.only)
    jobs = options.jobs or default_jobs()
    print(progress(steps, chosen, jobs), flush=True)
    if options.again:
        print(
            f"again=true measures these again, and trains what has no whole run in {options.runs}", flush=True
        )
    if not options.run:
        print("run=true runs what is missing")
        return False
    runner = Runner(steps, jobs, options.minutes)
    whole = runner.run_again(chosen) if options.again else runner.run(chosen)
    print(progress(steps, chosen, jobs))
    return not whole


def read_options(values: Mapping[str, Any]) -> Options:
    """Check the options.

    Raises:
        ConfigError: One line that names the key.
    """
    only = values["only"]
    if only is not None and not isinstance(only, list):
        only = [str(only)]
    options = from_keys(Options, {**values, "only": only})
    if options.only is not None and not (options.only and all(options.only)):
        raise ConfigError("only: expected a step, a part of the names of some, or several of these")
    if options.again and options.only is None:
        raise ConfigError("again: name the steps, only=<part of a name>")
    return options


if __name__ == "__main__":
    main()
