"""The tables by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from spin_rl.reproduce.tables import corridors
from spin_rl.reproduce.tables.depth import depth
from spin_rl.reproduce.tables.dynamic import dynamic
from spin_rl.reproduce.tables.stored import Stored
from spin_rl.reproduce.tables.table import Table
from spin_rl.reproduce.tables.visibility import visibility

TABLES: Mapping[str, Callable[[Stored], Table]] = MappingProxyType(
    {
        "1": corridors.table_1,
        "fixcam": corridors.fixcam,
        "visibility": visibility,
        "dynamic": dynamic,
        "depth": depth,
    }
)
"""Value of `table=` -> what makes the table of stored results."""
