"""All tables as one page: docs/results.md, which nobody writes by hand."""

from __future__ import annotations

from pathlib import Path

from spin_rl.reproduce.plan import PAPER, read_steps
from spin_rl.reproduce.tables.registry import ALL, PLANS, TABLES
from spin_rl.reproduce.tables.stored import NothingStored, Stored
from spin_rl.reproduce.tables.table import heading, markdown, missing_block
from spin_rl.tasks.common.compose import compose

_HEAD = f"""# Results

The paper's tables beside ours, of what is stored in [results/](../results): `spin-eval table={ALL}
out=docs/results.md` writes this page. See [how to make it all again](reproduce.md), and [what the shipped
policies do](shipped_policies.md).
"""


def open_stored(name: str) -> Stored:
    """The stored results for a table.

    Args:
        name: Value of `table=`.
    """
    settings = compose("reproduce", [f"plan={PLANS[name]}"])
    return Stored(read_steps(settings["plan"], Path(settings["runs"])), name)


def page() -> str:
    """Every table in Markdown; of one of the paper's without any result, the command that makes it.

    Raises:
        ConfigError: A stored result is damaged; one line that names it.
    """
    sections = map(_section, TABLES)
    return "\n".join([_HEAD, *(section for section in sections if section is not None)])


def _section(name: str) -> str | None:
    """A table; None of another plan than the paper's that cannot be made yet."""
    stored = open_stored(name)
    try:
        return markdown(TABLES[name](stored))
    except NothingStored:
        if PLANS[name] != PAPER:
            return None
        assert stored.rest is not None
        return f"{heading(name)}\n\n{missing_block(stored.rest)}\n"
