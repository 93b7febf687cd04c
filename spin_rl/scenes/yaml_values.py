"""Checked values out of a parsed YAML file; what is wrong with them is one line that names the key."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from spin_rl.config import ConfigError

MAX_EXTENT_M = 1000.0
"""Largest coordinate or size."""


def mapping(
    value: Any, where: str, allowed: tuple[str, ...] | None, required: tuple[str, ...] = ()
) -> Mapping[str, Any]:
    """A mapping with all required keys and none but the allowed ones; any keys where those are None."""
    if not isinstance(value, Mapping):
        wanted = "names" if allowed is None else f"keys {', '.join(allowed)}"
        raise ConfigError(f"{where}: expected {wanted}, got {short(value)}")
    for key in value:
        if allowed is not None and key not in allowed:
            raise ConfigError(f"{where}: unknown key {short(key)}; choose from {', '.join(allowed)}")
    for key in required:
        if key not in value:
            raise ConfigError(f"{where}: {key} is missing")
    return value


def entries(value: Any, where: str) -> list[Any]:
    """A list of anything, empty for None."""
    if value is None:
        return []
    if not isinstance(value, list):
        raise ConfigError(f"{where}: expected a list, got {short(value)}")
    return value


def numbers(value: Any, where: str, lengths: tuple[int, ...]) -> list[float]:
    """A list of numbers, as many as one of the lengths."""
    if not isinstance(value, list) or len(value) not in lengths:
        wanted = " or ".join(str(length) for length in lengths)
        raise ConfigError(f"{where}: expected a list of {wanted} numbers, got {short(value)}")
    return [number(item, where) for item in value]


def number(value: Any, where: str) -> float:
    """A finite number, of at most `MAX_EXTENT_M` either way."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= MAX_EXTENT_M:
        raise ConfigError(
            f"{where}: expected a number of at most {MAX_EXTENT_M:g} either way, got {short(value)}"
        )
    return float(value)


def positive(value: Any, where: str) -> float:
    """A number over 0."""
    result = number(value, where)
    if result <= 0.0:
        raise ConfigError(f"{where}: must be positive, got {value!r}")
    return result


def short(value: Any) -> str:
    """One line about any value."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
