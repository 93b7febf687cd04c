"""A YAML file that someone wrote, and checked values out of it; what is wrong is told in one line."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from spin_rl.config import ConfigError, short

MAX_EXTENT_M = 1000.0
"""Largest coordinate or size."""

MAX_BYTES = 256_000
"""Largest file: parsing takes time in proportion."""
MAX_DEPTH = 20
"""Most collections inside each other."""
MAX_VALUES = 50_000
"""Most values."""

# The parser in C where PyYAML was built with it: many times as fast.
_SafeLoader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Loader(_SafeLoader):
    """Plain values only, and no key twice in a mapping: the second would replace the first without a word."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Build a mapping, as the base class does."""
        seen = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue  # which cannot be a key
            if key.value in seen:
                problem = f"the key {short(key.value)} is there twice"
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def read_yaml(path: Path) -> Any:
    """Read a YAML file of plain values: no larger and no deeper than people write.

    Raises:
        ConfigError: The file cannot be read or is something else; one line that names the file.
    """
    try:
        if path.exists() and not path.is_file():
            raise ConfigError(f"{path}: cannot read the file: it is not a regular one")
        with open(path, "rb") as file:
            content = file.read(MAX_BYTES + 1)
        if len(content) > MAX_BYTES:
            raise ConfigError(f"{path}: larger than {MAX_BYTES // 1000} kB")
        text = content.decode()
        _check_events(text)
        return yaml.load(text, Loader=_Loader)
    except ConfigError:
        raise
    except OSError as error:
        raise ConfigError(f"{path}: cannot read the file: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: not a text file in UTF-8") from None
    except yaml.MarkedYAMLError as error:
        where = f" at line {error.problem_mark.line + 1}" if error.problem_mark else ""
        raise ConfigError(f"{path}: not valid YAML{where}: {error.problem}") from None
    # Values that a tag does not fit have errors of any kind: `!!bool abc` is a KeyError.
    except (yaml.YAMLError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise ConfigError(f"{path}: not valid YAML: {type(error).__name__}") from None


def _check_events(text: str) -> None:
    """Refuse, before anything is built, what would take much memory or time to build or to show.

    Aliases are counted as what they stand for: a few lines of them can stand for billions of values.
    """
    open_counts = [0]
    open_anchors: list[str | None] = [None]
    sizes: dict[str | None, int] = {}
    for event in yaml.parse(text, Loader=_SafeLoader):
        size, anchor, problem = 0, getattr(event, "anchor", None), None
        if isinstance(event, yaml.CollectionStartEvent):
            open_counts.append(0)
            open_anchors.append(anchor)
        elif isinstance(event, yaml.CollectionEndEvent):
            size, anchor = open_counts.pop() + 1, open_anchors.pop()
            sizes[anchor] = size
        elif isinstance(event, yaml.AliasEvent):
            size = sizes.get(anchor, 0)
            problem = None if size else f"*{anchor} stands for nothing yet"
        elif isinstance(event, yaml.ScalarEvent):
            size = sizes[anchor] = 1
        open_counts[-1] += size
        if len(open_counts) > MAX_DEPTH:
            problem = f"more than {MAX_DEPTH} lists and mappings inside each other"
        if open_counts[-1] > MAX_VALUES:
            problem = f"more than {MAX_VALUES} values"
        if problem is not None:
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=event.start_mark)


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
