"""Observation groups by their names: which a model encodes, and which come from the camera."""

from __future__ import annotations

from collections.abc import Collection

OBJECT = "object"
"""Where the object is while the camera sees it, a flat group (SPIN, F(o_t, x_t))."""
OBJECT_AT_START = "object_at_start"
"""`OBJECT` as if it was seen and had not moved since the start: o_i in its columns."""
HAND_IN_IMAGE = "hand_in_image"
"""Where the hand is in the depth image, a flat group: from -1 to 1 to the right and down, and its depth."""

PRIVILEGED = "privileged"
"""What only a critic may know."""


def is_depth(group: str) -> bool:
    """Tell whether a group is of depth images."""
    return group.startswith("depth")


def is_encoded(group: str) -> bool:
    """Tell whether a model has an encoder for a group, instead of a normalizer."""
    return group.startswith("scandots") or is_depth(group)


def is_seen(group: str) -> bool:
    """Tell whether a group holds what the camera sees, as an image or in place of one."""
    return is_encoded(group) or group == OBJECT


def replaceable_group(groups: Collection[str]) -> str:
    """Return the one group whose place an image can take, scandots or the object (SPIN 2.2).

    Raises:
        ValueError: There is none, or several; one line that names the groups.
    """
    seen = [group for group in groups if is_seen(group)]
    if len(seen) != 1 or is_depth(seen[0]):
        raise ValueError(
            f"it reads {', '.join(groups)}; a teacher reads one group of what the camera sees, scandots or "
            f"{OBJECT}, and no images."
        )
    return seen[0]
