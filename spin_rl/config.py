"""From Hydra's nested mappings to the dataclasses that the code uses, with errors that name the key.

A field says what it takes by its type, and more narrowly by an `Annotated` type with one of `Range`,
`Choice`, `Rising`, `Length` and `Means`. A number of which it says no more is at most `LARGEST` either way:
more cannot be meant. The settings of models and algorithms are checked in the same way, by the types of
their constructors' arguments; see `check_value`.
"""

from __future__ import annotations

import dataclasses
import math
import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")
_NOUNS = {int: "a whole number", float: "a number", bool: "true or false", str: "a name", Path: "a path"}
_LONGEST_VALUE = 60
_GENEROUS = 1e5
"""From here on, the end of a range is told to those only who went beyond it."""
LARGEST = 1e6
"""Greatest number, either way, where a setting's type says nothing else."""


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
        return reached and value <= self.high and abs(value) != math.inf

    def narrow(self, noun: str) -> str:
        """Say which of `noun` are meant."""
        most = "" if self.high >= _GENEROUS else f" up to {self.high:g}"
        if self.above:
            positive = f"{noun} above {self.low:g}" if self.low else noun.replace("a ", "a positive ", 1)
            return positive + most
        if math.isinf(self.low):
            return noun + most
        return f"{noun} from {self.low:g} on" if not most else f"{noun} from {self.low:g}{most[3:]}"


@dataclass(frozen=True)
class Choice:
    """One of some names or numbers."""

    options: tuple[str | int, ...]

    def check(self, value: Any, where: str) -> None:
        """Raise a `ConfigError` for anything else."""
        if not any(value == option and type(value) is type(option) for option in self.options):
            known = ", ".join(map(str, self.options))
            raise ConfigError(f"{where}: unknown {short(value)}; choose from {known}")


@dataclass(frozen=True)
class Rising:
    """Two numbers, the lower one first."""

    def allows(self, value: Any) -> bool:
        """Whether they are in order."""
        return value[0] < value[1]

    def narrow(self, noun: str) -> str:
        """Say what is meant."""
        return "two numbers, the lower one first"


@dataclass(frozen=True)
class Length:
    """A list of `low` to `high` values."""

    low: int
    high: int

    def allows(self, value: Any) -> bool:
        """Whether there are so many."""
        return self.low <= len(value) <= self.high

    def narrow(self, noun: str) -> str:
        """Say how many are meant."""
        return f"a list of {self.low} to {self.high} values"


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


@dataclass(frozen=True)
class Text:
    """Words, also none at all; where a name is meant, an empty one is refused."""

    def check(self, value: Any, where: str) -> None:
        """Raise a `ConfigError` for anything else."""
        if not isinstance(value, str):
            raise ConfigError(f"{where}: expected a text, got {short(value)}")


POSITIVE = Range(0.0, above=True)


def from_keys(cls: type[T], values: Mapping[str, Any], path: str = "") -> T:
    """Build a dataclass from those keys of a larger configuration that it has; see `from_mapping`."""
    names = [f.name for f in dataclasses.fields(cls)]
    return from_mapping(cls, {name: values[name] for name in names if name in values}, path)


def from_mapping(cls: type[T], values: Mapping[str, Any], path: str = "") -> T:
    """Build a (nested) dataclass from a mapping.

    Args:
        cls: A dataclass; nested dataclass fields take nested mappings.
        values: One value per field, missing ones keep their defaults; nested dataclasses are taken as such.
        path: Where the mapping stands in the configuration, for messages.

    Raises:
        ConfigError: An unknown or missing key, or a value that the field does not take.
    """
    values = _mapping(values, path or "the configuration")
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


def check_value(hint: Any, value: Any, where: str) -> Any:
    """Turn a value into what a type says, as for a field of a dataclass.

    Args:
        hint: Type, such as `Annotated[int, Range(1)]`.
        value: Of built-in types.
        where: What messages call it.

    Raises:
        ConfigError: The type does not take it.
    """
    return _convert(hint, value, where)


def short(value: Any) -> str:
    """Show any value in part of a line."""
    if isinstance(value, Mapping | list | tuple) and len(value) > _LONGEST_VALUE:
        return f"{type(value).__name__} of {len(value)} values"
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # thousands of digits, or of lists inside each other
        return f"a very large {type(value).__name__}"
    return text if len(text) <= _LONGEST_VALUE else f"{text[: _LONGEST_VALUE - 3]}..."


def _convert(hint: Any, value: Any, where: str, expected: str = "", limited: bool = True) -> Any:
    """Turn a value into what a type says.

    Args:
        hint: The type.
        value: The value.
        where: What messages call it.
        expected: What is expected, if a type around it says more.
        limited: Whether numbers are at most `LARGEST`, since no type around it gives a range.
    """
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    expected = expected or _expected(hint)
    refused = ConfigError(f"{where}: expected {expected}, got {short(value)}")
    if hint is Any:
        return value
    if origin is Annotated:
        rule = arguments[1]
        if isinstance(rule, Choice | Text):
            rule.check(value, where)
            return value
        result = _convert(arguments[0], value, where, expected, limited=not isinstance(rule, Range))
        if isinstance(rule, Range) and result > rule.high >= _GENEROUS:
            raise ConfigError(f"{where}: expected {expected}, at most {rule.high:g}, got {short(value)}")
        if not rule.allows(result):
            raise refused
        return result
    if dataclasses.is_dataclass(hint):
        if isinstance(value, typing.cast(type, hint)):
            return value
        return from_mapping(typing.cast(type, hint), _mapping(value, where), where)
    if origin in (types.UnionType, typing.Union):
        if value is None and type(None) in arguments:
            return None
        return _convert(_not_none(arguments), value, where, expected)
    if origin is tuple:
        return _convert_tuple(arguments, value, where)
    if origin is Sequence:
        return _convert_tuple((*arguments, Ellipsis), value, where)
    if origin in (dict, Mapping) or hint in (dict, Mapping):
        own = arguments[1] if arguments else Any
        return {key: _convert(own, v, f"{where}.{key}") for key, v in _mapping(value, where).items()}
    if hint is Path and isinstance(value, str | Path) and str(value) and "\0" not in str(value):
        return Path(value)
    if hint is float and type(value) is int and abs(value) <= 1e300:
        value = float(value)
    if type(value) is not hint or (hint is str and not value):
        raise refused
    if limited and isinstance(value, int | float) and not abs(value) <= LARGEST:
        raise ConfigError(
            f"{where}: expected {expected} of at most {LARGEST:g} either way, got {short(value)}"
        )
    return value


def _mapping(value: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise ConfigError(f"{where}: expected a mapping, got {short(value)}")
    return value


def _expected(hint: Any) -> str:
    """Say in words what a type takes."""
    arguments = typing.get_args(hint)
    if typing.get_origin(hint) is Annotated:
        rule = arguments[1]
        return "" if isinstance(rule, Choice | Text) else rule.narrow(_expected(arguments[0]))
    if type(None) in arguments:
        return f"{_expected(_not_none(arguments))} or null"
    return _NOUNS.get(hint, str(hint))


def _not_none(hints: tuple[Any, ...]) -> Any:
    return next(hint for hint in hints if hint is not type(None))


def _convert_tuple(items: tuple[Any, ...], value: Any, where: str) -> tuple[Any, ...]:
    if not isinstance(value, (list, tuple)):
        raise ConfigError(f"{where}: expected a list, got {short(value)}")
    if len(items) == 2 and items[1] is Ellipsis:
        items = (items[0],) * len(value)
    if len(value) != len(items):
        raise ConfigError(f"{where}: expected {len(items)} values, got {len(value)}")
    return tuple(
        _convert(item, v, f"{where}[{i}]") for i, (item, v) in enumerate(zip(items, value, strict=True))
    )
