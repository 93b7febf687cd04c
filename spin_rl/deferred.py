"""Functions and classes whose modules are imported when they are first called.

Registries name so what is slow to import: a bad setting is refused before Torch is imported.
"""

from __future__ import annotations

from dataclasses import dataclass
from pkgutil import resolve_name
from typing import Any


@dataclass(frozen=True)
class Deferred:
    """Calls what a name such as `package.module:name` stands for; pickles and compares as the name."""

    name: str

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Import the module and call."""
        return resolve_name(self.name)(*args, **kwargs)
