"""A table for the terminal, Markdown, CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

from spin_rl.benchmark.tables.reach import align
from spin_rl.reproduce.tables.missing import Missing
from spin_rl.reproduce.tables.rates import Rate, difference, spread
from spin_rl.reproduce.tables.texts import TEXTS

_COLUMNS = 120
"""Of a line in Markdown, but for tables and commands."""


Kind = Literal["more", "alike", "disputed"]
"""What the paper claims of a difference: that there is one, that there is none, or both in two places."""
_ALIKE = 0.10
"""Differences below this are none."""
NOT_SHOWN = "not shown: trainings differ by more than this"
"""What is said of what not all pairs of trainings bear out: an interval knows scenes alone."""


@dataclass(frozen=True)
class Claim:
    """An ordering that the paper claims.

    Attributes:
        text: What it says.
        ours: Difference that was measured here.
        low: Lower end of its 95 % interval.
        high: Upper end.
        trainings: Smallest and largest difference between a training of one and of the other; None with one
            training of each, or none.
        paper: Difference in the paper; None where it gives none.
        wanted: Difference from which it is counted as reproduced, where one is claimed.
        kind: Where the paper disputes itself, its text says that there is a difference.
    """

    text: str
    ours: float
    low: float
    high: float
    trainings: tuple[float, float] | None
    paper: float | None
    wanted: float
    kind: Kind = "more"

    @property
    def verdict(self) -> str:
        """What the measurement says of it."""
        if self.kind == "alike":
            return self._verdict_of_alike()
        if self.low <= 0.0 <= self.high:
            return "no difference shown"
        is_better = self.low > 0.0
        if self.kind == "disputed":
            told = (
                "as the text says, against the table" if is_better else "as the table says, against the text"
            )
        elif is_better:
            told = self._verdict_of_more()
        else:
            told = "the other way round"
        return self.qualified(told)

    def qualified(self, verdict: str) -> str:
        """A verdict, or that it is none, where it holds between some pairs of trainings alone."""
        low, high = self.trainings or (self.ours, self.ours)
        return verdict if low > 0.0 or high < 0.0 else NOT_SHOWN

    def _verdict_of_more(self) -> str:
        if self.ours < self.wanted:
            return "same direction, less of it"
        if self.paper is not None and self.ours < 0.5 * self.paper:
            return "reproduced, by less than half of the paper's"
        if self.paper is not None and self.ours > 2.0 * self.paper:
            return "reproduced, by more than twice the paper's"
        return "reproduced"

    def _verdict_of_alike(self) -> str:
        if -_ALIKE < self.low and self.high < _ALIKE:
            far = max(map(abs, self.trainings or (0.0,)))
            return "reproduced" if far < _ALIKE else NOT_SHOWN
        if self.low <= 0.0 <= self.high:
            return "neither a difference nor its absence shown"
        return self.qualified("better" if self.ours > 0.0 else "worse")

    def line(self) -> str:
        """All of it in a line."""
        paper = "not given" if self.paper is None else f"{self.paper:+.2f}"
        wanted = {"more": f"wanted {self.wanted:+.2f}", "alike": f"wanted within {_ALIKE:.2f}"}.get(self.kind)
        told = ", ".join(filter(None, [f"paper {paper}", wanted]))
        return f"{self.text}: {self.measured()}, {told}: {self.verdict}"

    def measured(self) -> str:
        """The difference, its interval and that between trainings."""
        between = "no pairs of trainings to compare"
        if self.trainings is not None:
            between = "between trainings {:+.2f} to {:+.2f}".format(*self.trainings)
        return f"{self.ours:+.2f} ({self.low:+.2f} to {self.high:+.2f}; {between})"


def compare(
    text: str,
    one: Rate,
    other: Rate,
    *,
    paper: float | None,
    wanted: float = 0.0,
    kind: Kind = "more",
) -> Claim:
    """Compare two kinds of trainings in the same scenes.

    Args:
        text: What the paper claims.
        one: Those that should be better.
        other: The others.
        paper: Difference in the paper.
        wanted: Difference from which the claim counts as reproduced.
        kind: What is claimed.
    """
    return Claim(text, *difference(one, other), spread(one.each, other.each), paper, wanted, kind)


@dataclass(frozen=True)
class Table:
    """A table of the paper beside ours.

    Attributes:
        name: Value of `table=`.
        header: Headings.
        rows: Cells as text.
        records: The figures, one mapping a figure or row, for CSV and JSON.
        claims: Orderings that the paper claims.
        notes: What a reader has to know: budgets, intervals, machine, commands.
        missing: Results that would make further rows; None where all are there.
    """

    name: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    records: tuple[Mapping[str, Any], ...]
    claims: tuple[Claim, ...] = ()
    notes: tuple[str, ...] = ()
    missing: Missing | None = None

    @property
    def title(self) -> str:
        """What it shows."""
        return TEXTS[self.name].title


def terminal(table: Table) -> str:
    """Format a table for the terminal."""
    lines = align([list(table.header), *map(list, table.rows)])
    rest = [] if table.missing is None else [table.missing.line()]
    return "\n".join([table.title, *lines, *(claim.line() for claim in table.claims), *table.notes, *rest])


def markdown(table: Table) -> str:
    """Format a table as Markdown, with its heading, its sentences and its command."""
    rows = [table.header, ("---",) * len(table.header), *table.rows]
    lines = [f"| {' | '.join(cell.replace('|', '/') for cell in row)} |" for row in rows]
    told = [*(claim.line() for claim in table.claims), *table.notes]
    items = [_wrapped(f"- {text}", "  ") for text in told]
    blocks = [heading(table.name), "\n".join(lines), "\n".join(items)]
    if table.missing is not None:
        blocks.append(missing_block(table.missing))
    return "\n\n".join(block for block in blocks if block) + "\n"


def heading(name: str) -> str:
    """What stands over a table in Markdown, also where nothing of it is there yet."""
    text = TEXTS[name]
    return f"## {text.title}\n\n{_wrapped(text.about)}\n\n    spin-eval table={name}"


def missing_block(missing: Missing) -> str:
    """What is missing, and the command that makes it, in Markdown."""
    return f"{missing.text().capitalize()}:\n\n    {missing.command}"


def _wrapped(text: str, indent: str = "") -> str:
    return textwrap.fill(
        text, _COLUMNS, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )


def csv_text(table: Table) -> str:
    """Format the records of a table as CSV, a column for every key."""
    keys = list(dict.fromkeys(key for record in table.records for key in record))
    text = io.StringIO()
    writer = csv.DictWriter(text, keys, lineterminator="\n")
    writer.writeheader()
    writer.writerows(table.records)
    return text.getvalue()


def json_text(table: Table) -> str:
    """Format the whole table as JSON."""
    values = asdict(table) | {
        "title": table.title,
        "claims": [asdict(claim) | {"verdict": claim.verdict} for claim in table.claims],
    }
    return json.dumps(values, indent=2, allow_nan=False) + "\n"


FORMATS: dict[str, Callable[[Table], str]] = {
    ".md": markdown,
    ".csv": csv_text,
    ".json": json_text,
    ".txt": terminal,
}
"""Ending of a file -> what is written into it."""
