"""From Hydra's nested mappings to the dataclasses that the code uses, with errors that name the key."""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Mapping
from typing import Any, TypeVar

T = TypeVar("T")


class ConfigError(ValueError):
    """A configuration that cannot be used; the message is one line that names the key."""


def from_mapping(cls: type[T], values: Mapping[str, Any], path: str = "") -> T:
    """Build a (nested) dataclass from a mapping.

    Args:
        cls: A dataclass; nested dataclass fields take nested mappings.
        values: One value per field, missing ones keep their defaults; nested dataclasses are taken as such.
        path: Where the mapping stands in the configuration, for messages.

    Raises:
        ConfigError: An unknown key, or a value of the wrong type.
    """
    hints = typing.get_type_hints(cls)
    names = [f.name for f in dataclasses.fields(cls)]  # type: ignore[arg-type]
    arguments = {}
    for key, value in values.items():
        where = f"{path}.{key}" if path else str(key)
        if key not in names:
            raise ConfigError(f"{where}: unknown key; choose from {', '.join(names)}")
        arguments[key] = _convert(hints[key], value, where)
    try:
        return cls(**arguments)
    except ValueError as error:
        raise ConfigError(str(error)) from error


def _convert(hint: Any, value: Any, where: str) -> Any:
    origin = typing.get_origin(hint)
    if dataclasses.is_dataclass(hint):
        if isinstance(value, typing.cast(type, hint)):
            return value
        if not isinstance(value, Mapping):
            raise ConfigError(f"{where}: expected a mapping, got {value!r}")
        return from_mapping(typing.cast(type, hint), value, where)
    if origin is types.UnionType:
        if value is None and type(None) in typing.get_args(hint):
            return None
        return _convert(next(h for h in typing.get_args(hint) if h is not type(None)), value, where)
    if origin is tuple:
        return _convert_tuple(typing.get_args(hint), value, where)
    if origin is dict:
        if not isinstance(value, Mapping):
            raise ConfigError(f"{where}: expected a mapping, got {value!r}")
        item = typing.get_args(hint)[1]
        return {key: _convert(item, v, f"{where}.{key}") for key, v in value.items()}
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if isinstance(hint, type) and (type(value) is hint):
        return value
    expected = getattr(hint, "__name__", str(hint))
    raise ConfigError(f"{where}: expected {expected}, got {value!r}")


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
