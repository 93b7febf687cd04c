"""Warp structs from objects that have their fields as attributes, such as configurations."""

from typing import Any


def struct_of(kind: Any, source: object, **others: Any) -> Any:
    """Make a Warp struct of a kind.

    Args:
        kind: The struct.
        source: Has the values of all fields but `others`, by name; tuples become vectors.
        **others: Values of fields that it lacks.

    Raises:
        AttributeError: A field has no value.
        TypeError: There is no field for a value.
    """
    unknown = sorted(set(others) - set(kind.vars))
    if unknown:
        raise TypeError(f"{kind.key} has no field {unknown[0]}")
    struct = kind()
    for name, var in kind.vars.items():
        value = others[name] if name in others else getattr(source, name)
        setattr(struct, name, var.type(*value) if isinstance(value, tuple) else value)
    return struct
