"""spin-eval table=<name>: the paper's tables beside ours, of stored results or measured again."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from spin_rl.cli import common
from spin_rl.config import Choice, ConfigError, from_keys
from spin_rl.machine import num_cores
from spin_rl.reproduce.plan import read_steps
from spin_rl.reproduce.run import Runner
from spin_rl.reproduce.tables import table as tables
from spin_rl.reproduce.tables.registry import PLANS, TABLES
from spin_rl.reproduce.tables.stored import Stored
from spin_rl.tasks.common.compose import compose

_OPTIONS = ("table", "fresh", "out")


@dataclass(frozen=True)
class Options:
    """Which table, checked; see conf/eval.yaml."""

    table: Annotated[str, Choice(tuple(TABLES))]
    fresh: bool
    out: Path | None


def show(call: common.Call) -> bool:
    """Print a table and write its file.

    Raises:
        ConfigError: A result is missing; one line with the command that makes it. Or an option does not fit.
    """
    options = read_options(call)
    settings = compose("reproduce", [f"plan={PLANS[options.table]}"])
    steps = read_steps(settings["plan"], Path(settings["runs"]))
    stored = Stored(steps, options.table)
    table = TABLES[options.table](stored)
    if options.fresh:
        Runner(steps, num_cores()).measure_again(stored.used)
        table = TABLES[options.table](Stored(steps, options.table))
    print(tables.terminal(table))
    if options.out is None:
        print("(out=<file.md, .csv, .json or .txt> keeps it)")
    else:
        tables.write(table, options.out)
        print(f"Wrote {options.out}")
    return False


def read_options(call: common.Call) -> Options:
    """Reject what does not go with a table.

    Raises:
        ConfigError: One line that names the key.
    """
    values = call.values
    options = from_keys(Options, {**values, "table": str(values["table"])})
    for override in call.overrides:
        key = override.lstrip("+~").partition("=")[0]
        if key not in _OPTIONS:
            raise ConfigError(f"{key}: table={options.table} is of stored results, which have their own")
    if options.out is not None:
        tables.check_format(options.out)
        common.make_folder_of(options.out, f"{options.table}.md")
    return options
