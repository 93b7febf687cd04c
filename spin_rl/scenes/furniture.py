"""What a scene file puts into the world: walls, boxes and cylinders, its own and those of its furniture."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from spin_rl.config import ConfigError, short
from spin_rl.paths import CONF_DIR
from spin_rl.scenes.yaml_values import entries, mapping, number, numbers, read_yaml

KINDS = ("walls", "boxes", "cylinders")
"""Kinds of parts, in the order of the pool's slots."""


@dataclass(frozen=True)
class Part:
    """One wall, box or cylinder as it is written.

    Attributes:
        kind: One of `KINDS`.
        where: What messages call it.
        entry: Its content, not checked yet.
        frame: Of the piece of furniture that it belongs to, in the world: x, y, z [m], yaw [rad].
    """

    kind: str
    where: str
    entry: Any
    frame: tuple[float, float, float, float] | None = None


def read_parts(top: Mapping[str, Any]) -> list[Part]:
    """All parts of a scene file, in the order of the pool's slots.

    Args:
        top: The file's content.

    Raises:
        ConfigError: What should be a list is none, or a piece of furniture is unknown or nowhere.
    """
    parts = [
        Part(kind, f"{kind}[{i}]", entry)
        for kind in KINDS
        for i, entry in enumerate(entries(top.get(kind), kind))
    ]
    return sorted([*parts, *_furniture(top)], key=lambda part: KINDS.index(part.kind))


@lru_cache(maxsize=1)
def furniture_library() -> Mapping[str, Any]:
    """The pieces of conf/furniture.yaml by name, as they are written."""
    return read_yaml(CONF_DIR / "furniture.yaml")


def _furniture(top: Mapping[str, Any]) -> Iterator[Part]:
    """The parts of all pieces of furniture."""
    pieces = {**furniture_library(), **mapping(top.get("pieces", {}), "pieces", None)}
    for i, entry in enumerate(entries(top.get("furniture"), "furniture")):
        where = f"furniture[{i}]"
        values = mapping(entry, where, ("piece", "position", "yaw"), required=("piece", "position"))
        name = values["piece"]
        if not isinstance(name, str) or name not in pieces:
            raise ConfigError(f"{where}.piece: unknown {short(name)}; choose from {', '.join(pieces)}")
        position = numbers(values["position"], f"{where}.position", (2, 3))
        x, y, z = (*position, 0.0)[:3]
        frame = (x, y, z, number(values.get("yaw", 0.0), f"{where}.yaw"))
        piece = mapping(pieces[name], f"pieces.{name}", KINDS)
        for kind in KINDS:
            for j, part in enumerate(entries(piece.get(kind), f"pieces.{name}.{kind}")):
                yield Part(kind, f"pieces.{name}.{kind}[{j}]", part, frame)
