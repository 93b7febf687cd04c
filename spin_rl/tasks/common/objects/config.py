"""Settings of tasks with an object to pick up: which it is, and how it is found."""

from __future__ import annotations

import math
from dataclasses import dataclass

from spin_rl.scenes.objects.shapes import OBJECTS

ANY_OBJECT = "any"
DETECTORS = ("none", "segmentation")


def object_names(choice: str) -> tuple[str, ...]:
    """Split `task.object`: "banana+any" gives the worlds a banana and any object in turn."""
    return tuple(choice.split("+"))


def check_object(choice: str) -> None:
    """Reject a value of `task.object` that is none.

    Raises:
        ValueError: One of its names is neither one of `objects.OBJECTS` nor "any".
    """
    for name in object_names(choice):
        if name != ANY_OBJECT and name not in OBJECTS:
            raise ValueError(
                f"task.object must be {ANY_OBJECT} or one of {', '.join(OBJECTS)}, or several joined by +, "
                f"got {name!r}"
            )


@dataclass(frozen=True)
class SightConfig:
    """When the camera sees the object, without a detector.

    Attributes:
        near_m: Smallest depth [m].
        far_m: Largest depth [m].
        occlusion: Whether table, walls and boxes hide the object.
    """

    near_m: float = 0.1
    far_m: float = 4.0
    occlusion: bool = True

    def __post_init__(self) -> None:
        """Reject a range that is none."""
        if not 0.0 < self.near_m < self.far_m < math.inf:
            raise ValueError(
                f"task.sight: near_m must be positive and below far_m, got {self.near_m}, {self.far_m}"
            )


def check_detector(detector: str) -> None:
    """Reject what is none of `DETECTORS`.

    Raises:
        ValueError: It is not.
    """
    if detector not in DETECTORS:
        raise ValueError(f"task.detector must be one of {', '.join(DETECTORS)}, got {detector!r}")
