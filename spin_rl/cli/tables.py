"""spin-eval table=<name>: the paper's tables beside ours, of stored results or measured again."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from spin_rl.cli import common
from spin_rl.config import Choice, ConfigError, from_keys
from spin_rl.files import write_text
from spin_rl.reproduce.run import Runner, default_jobs
from spin_rl.reproduce.tables import table as tables
from spin_rl.reproduce.tables.page import open_stored, page
from spin_rl.reproduce.tables.registry import ALL, TABLES
from spin_rl.reproduce.tables.table import Table

_OPTIONS = ("table", "fresh", "out")


@dataclass(frozen=True)
class Options:
    """Which table, or all of them, checked; see conf/eval.yaml."""

    table: Annotated[str, Choice((*TABLES, ALL))]
    fresh: bool
    out: Path | None


def show(call: common.Call) -> bool:
    """Print a table and write its file, or all of them.

    Raises:
        ConfigError: There is no result for it, or a damaged one; one line with the command that makes it. Or
            an option does not fit.
    """
    options = read_options(call)
    if options.table == ALL:
        text = page()
        print(text)
    else:
        table = _make(options.table, options.fresh)
        print(tables.terminal(table))
        text = "" if options.out is None else tables.FORMATS[options.out.suffix](table)
    if options.out is None:
        print(f"(out=<file{' or '.join(_formats(options.table))}> keeps it)")
    else:
        write_text(options.out, text)
        print(f"Wrote {options.out}")
    return False


def _make(name: str, fresh: bool) -> Table:
    stored = open_stored(name)
    if fresh:
        TABLES[name](stored)
        Runner(stored.steps, default_jobs()).measure_again(stored.used)
        stored = open_stored(name)
    return TABLES[name](stored)


def _formats(table: str) -> tuple[str, ...]:
    return (".md",) if table == ALL else tuple(tables.FORMATS)


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
    if options.fresh and options.table == ALL:
        raise ConfigError(f"fresh: name one table, of {', '.join(TABLES)}")
    if options.out is not None:
        if options.out.suffix not in (known := _formats(options.table)):
            endings = " or ".join(known)
            raise ConfigError(f"out: table={options.table} is written to {endings}, not to {options.out}")
        common.make_folder_of(options.out, f"{options.table}.md")
    return options
