"""From Hydra's nested mappings to the dataclasses that the code uses, with errors that name the key.

A field says what it takes by its type, and more narrowly by an `Annotated` type with one of `Range`, `Choice`
and `Means`.
"""

from __future__ import annotations

import dataclasses
import math
import types
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")
_NOUNS = {int: "a whole number", float: "a number", bool: "true or false", str: "a name", Path: "a path"}


class ConfigError(ValueError):
    """A configuration that cannot be used; the message is one line that names the key."""


@dataclass(frozen=True)
class Range:
    """A finite number from `low` on, or above it, and up to `high`."""

    low: float = -math.inf
    high: float = math.inf
    above: bool = False

    def allows(self, value: Any) -> bool:
        """Whether a number is in the range."""
        reached = value > self.low if self.above else value >= self.low
        return math.isfinite(value) and reached and value <= self.high

    def narrow(self, noun: str) -> str:
        """Say which of `noun` are meant."""
        if self.above:
            return f"{noun} above {self.low:g}" if self.low else noun.replace("a ", "a positive ", 1)
        end = "on" if math.isinf(self.high) else f"to {self.high}"
        return noun if math.isinf(self.low) else f"{noun} from {self.low} {end}"


@dataclass(frozen=True)
class Choice:
    """One of some names or numbers."""

    options: tuple[str | int, ...]

    def check(self, value: Any, where: str) -> None:
        """Raise a `ConfigError` for anything else."""
        if not any(value == option and type(value) is type(option) for option in self.options):
            known = ", ".join(map(str, self.options))
            raise ConfigError(f"{where}: unknown {value!r}; choose from {known}")


@dataclass(frozen=True)
class Means:
    """What a value stands for, in the words of a message such as `expected the name of a policy`."""

    noun: str

    def allows(self, value: Any) -> bool:
        """Whatever has the type."""
        return True

    def narrow(self, noun: str) -> str:
        """Say what is meant."""
        return self.noun


POSITIVE = Range(0.0, above=True)


def from_keys(cls: type[T], values: Mapping[str, Any]) -> T:
    """Build a dataclass from those keys of a larger configuration that it has; see `from_mapping`."""
    names = [f.name for f in dataclasses.fields(cls)]
    return from_mapping(cls, {name: values[name] for name in names if name in values})


def from_mapping(cls: type[T], values: Mapping[str, Any], path: str = "") -> T:
    """Build a (nested) dataclass from a mapping.

    Args:
        cls: A dataclass; nested dataclass fields take nested mappings.
        values: One value per field, missing ones keep their defaults; nested dataclasses are taken as such.
        path: Where the mapping stands in the configuration, for messages.

    Raises:
        ConfigError: An unknown or missing key, or a value that the field does not take.
    """
    hints = typing.get_type_hints(cls, include_extras=True)
    fields = dataclasses.fields(cls)
    names = [f.name for f in fields]
    arguments = {}
    for key, value in values.items():
        where = f"{path}.{key}" if path else str(key)
        if key not in names:
            raise ConfigError(f"{where}: unknown key; choose from {', '.join(names)}")
        arguments[key] = _convert(hints[key], value, where)
    for f in fields:
        if f.name not in arguments and f.default is f.default_factory is dataclasses.MISSING:
            raise ConfigError(f"{path}.{f.name}: a value is needed".lstrip("."))
    try:
        return cls(**arguments)
    except ValueError as error:
        raise ConfigError(str(error)) from error


def _convert(hint: Any, value: Any, where: str, expected: str = "") -> Any:
    """Turn a value into what a type says; `expected` says what is if a type around it says more."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    expected = expected or _expected(hint)
    if origin is Annotated:
        rule = arguments[1]
        if isinstance(rule, Choice):
            rule.check(value, where)
            return value
        result = _convert(arguments[0], value, where, expected)
        if not rule.allows(result):
            raise ConfigError(f"{where}: expected {expected}, got {value!r}")
        return result
    if dataclasses.is_dataclass(hint):
        if isinstance(value, typing.cast(type, hint)):
            return value
        if not isinstance(value, Mapping):
            raise ConfigError(f"{where}: expected a mapping, got {value!r}")
        return from_mapping(typing.cast(type, hint), value, where)
    if origin in (types.UnionType, typing.Union):
        if value is None and type(None) in arguments:
            return None
        return _convert(_not_none(arguments), value, where, expected)
    if origin is tuple:
        return _convert_tuple(arguments, value, where)
    if origin is dict:
        if not isinstance(value, Mapping):
            raise ConfigError(f"{where}: expected a mapping, got {value!r}")
        return {key: _convert(arguments[1], v, f"{where}.{key}") for key, v in value.items()}
    if hint is Path and isinstance(value, str | Path):
        return Path(value)
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if isinstance(hint, type) and (type(value) is hint):
        return value
    raise ConfigError(f"{where}: expected {expected}, got {value!r}")


def _expected(hint: Any) -> str:
    """Say in words what a type takes."""
    arguments = typing.get_args(hint)
    if typing.get_origin(hint) is Annotated:
        rule = arguments[1]
        return "" if isinstance(rule, Choice) else rule.narrow(_expected(arguments[0]))
    if type(None) in arguments:
        return f"{_expected(_not_none(arguments))} or null"
    return _NOUNS.get(hint, str(hint))


def _not_none(hints: tuple[Any, ...]) -> Any:
    return next(hint for hint in hints if hint is not type(None))


def _convert_tuple(items: tuple[Any, ...], value: Any, where: str) -> tuple[Any, ...]:
    if not isinstance(value, (list, tuple)):
        raise ConfigError(f"{where}: expected a list, got {value!r}")
    if len(items) == 2 and items[1] is Ellipsis:
        items = (items[0],) * len(value)
    if len(value) != len(items):
        raise ConfigError(f"{where}: expected {len(items)} values, got {len(value)}")
    return tuple(
        _convert(item, v, f"{where}[{i}]") for i, (item, v) in enumerate(zip(items, value, strict=True))
    )
