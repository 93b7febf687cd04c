"""Results that a table lacks, and the command that makes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from spin_rl.reproduce.plan import Evaluation, Steps


@dataclass(frozen=True)
class Missing:
    """Results that are not there, or that were made by another plan than the present one.

    Attributes:
        names: Such as `reach/cvo-1`.
        command: What makes them, and nothing else but what they need.
    """

    names: tuple[str, ...]
    command: str

    @classmethod
    def of(cls, steps: Steps, missing: Sequence[Evaluation]) -> Missing:
        """Name some steps of a plan; those that differ in their seed alone are chosen together."""
        names = tuple(dict.fromkeys(step.name for step in missing))
        parts: list[str] = []
        for name in names:
            stem, _, seed = name.rpartition("-")
            alike = [other for other in steps.by_name if f"{stem}-" in other] if seed.isdigit() else []
            parts.append(f"{stem}-" if len(alike) > 1 and set(alike) <= set(names) else name)
        parts = list(dict.fromkeys(parts))
        only = f"only={parts[0]}" if len(parts) == 1 else f"'only=[{','.join(parts)}]'"
        return cls(names, steps.command(f"run=true {only}"))

    def text(self) -> str:
        """How much is missing."""
        return f"not measured yet, {len(self.names)} result{'s' if len(self.names) > 1 else ''}"

    def line(self) -> str:
        """That, and the command."""
        return f"{self.text()}: {self.command}"
