"""What a detector is: images in, boxes in pixels out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np


@dataclass(frozen=True)
class Detection:
    """An object in an upright image.

    Attributes:
        label: Name of its kind.
        score: Confidence in [0, 1].
        box: Top, bottom, left and right edge [pixels]: row i covers i to i + 1, so that the whole image is
            (0, rows, 0, columns).
    """

    label: str
    score: float
    box: tuple[float, float, float, float]

    @property
    def pixel(self) -> tuple[float, float]:
        """Row and column of the box's middle, whole numbers at the pixels' centres."""
        top, bottom, left, right = self.box
        return (top + bottom - 1.0) / 2.0, (left + right - 1.0) / 2.0


class Detector(Protocol):
    """Finds objects in one image; what a lab writes to plug its own in."""

    def __call__(self, image: np.ndarray, depth: np.ndarray) -> Sequence[Detection]:
        """Find objects.

        Args:
            image: Colours (red, green, blue), upright, shape (rows, columns, 3), uint8.
            depth: z-depth seen by the same pixels, 0 or not finite in holes [m], shape (rows, columns).

        Returns:
            What was found, in any order.
        """
        ...


def best_of(detections: Sequence[Detection], label: str) -> Detection | None:
    """Return the detection of a label with the highest score, None without any."""
    return max((d for d in detections if d.label == label), key=lambda d: d.score, default=None)
