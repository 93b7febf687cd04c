"""The tables by name; what makes them is imported when one is made."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

from spin_rl.deferred import Deferred
from spin_rl.reproduce.plan import PAPER

if TYPE_CHECKING:
    from spin_rl.reproduce.tables.stored import Stored
    from spin_rl.reproduce.tables.table import Table


def _make(module: str, name: str) -> Callable[[Stored], Table]:
    return Deferred(f"spin_rl.reproduce.tables.{module}:{name}")


TABLES: Mapping[str, Callable[[Stored], Table]] = MappingProxyType(
    {
        "1": _make("corridors", "table_1"),
        "place": _make("fetches", "place"),
        "fixcam": _make("corridors", "fixcam"),
        "visibility": _make("visibility", "visibility"),
        "dynamic": _make("dynamic", "dynamic"),
        "depth": _make("depth", "depth"),
        "active_camera": _make("active_camera", "active_camera"),
    }
)
"""Value of `table=` -> what makes the table of stored results."""
ALL = "all"
"""Value of `table=` for the page of all of them."""
PLANS: Mapping[str, str] = MappingProxyType(
    {name: PAPER for name in TABLES} | {"active_camera": "active_camera"}
)
"""Value of `table=` -> the plan whose results it shows, a file of conf/plan."""
