"""What surrounds a YOLO-family network: its input from an image, boxes from its output."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

_GREY = 114.0 / 255.0  # what these networks are trained to see beside the image


@dataclass(frozen=True)
class Letterbox:
    """How an image was put into the network's input: resized, then moved.

    Attributes:
        shape: Rows and columns of the image.
        scale: Size in the input / size in the image.
        shift: Row and column of the input where the image begins.
    """

    shape: tuple[int, int]
    scale: float
    shift: tuple[int, int]

    def to_image(self, boxes: np.ndarray) -> np.ndarray:
        """Turn boxes (top, bottom, left, right) of the input into the image's, cut at its edges: (n, 4)."""
        rows, columns = self.shape
        top, left = self.shift
        moved = (boxes - [top, top, left, left]) / self.scale
        return np.clip(moved, 0.0, [rows, rows, columns, columns])


def letterbox(image: np.ndarray, size: tuple[int, int]) -> tuple[np.ndarray, Letterbox]:
    """Fit an image into an input of another shape: resized without distortion, grey beside it.

    Args:
        image: Colours, shape (rows, columns, 3), uint8.
        size: Rows and columns of the input.

    Returns:
        The input in [0, 1], shape (1, 3, rows, columns), float32, and how the image lies in it.
    """
    rows, columns = image.shape[:2]
    scale = min(size[0] / rows, size[1] / columns)
    height, width = max(round(rows * scale), 1), max(round(columns * scale), 1)
    top, left = (size[0] - height) // 2, (size[1] - width) // 2
    tensor = np.full((1, 3, *size), _GREY, dtype=np.float32)
    planes = torch.from_numpy(np.array(image.transpose(2, 0, 1), dtype=np.float32, order="C"))
    resized = torch.nn.functional.interpolate(planes[None], (height, width), mode="bilinear")
    tensor[0, :, top : top + height, left : left + width] = resized[0].numpy() * np.float32(1.0 / 255.0)
    return tensor, Letterbox((rows, columns), scale, (top, left))


def decode(output: np.ndarray, num_labels: int) -> tuple[np.ndarray, np.ndarray]:
    """Read a network's output, of either common layout.

    - (1, 4 + labels, n): box and a score for every label, as YOLOv8 and its successors export.
    - (1, n, 5 + labels): box, a score of being an object, and the labels' given that it is one, as YOLOv5.

    Boxes are middle column, middle row, width and height.

    Returns:
        Boxes (top, bottom, left, right) in the input [pixels], shape (n, 4), and scores, shape (n, labels).

    Raises:
        ValueError: The shape is neither.
    """
    shape = output.shape
    if len(shape) == 3 and shape[0] == 1 and shape[1] == 4 + num_labels:
        rows = output[0].T
        scores = rows[:, 4:]
    elif len(shape) == 3 and shape[0] == 1 and shape[2] == 5 + num_labels:
        rows = output[0]
        scores = rows[:, 4:5] * rows[:, 5:]
    else:
        raise ValueError(
            f"the output has shape {list(shape)}; with {num_labels} labels it must be "
            f"[1, {4 + num_labels}, n] or [1, n, {5 + num_labels}]"
        )
    x, y, width, height = rows[:, :4].T
    return np.stack([y - height / 2, y + height / 2, x - width / 2, x + width / 2], axis=1), scores


def suppress(boxes: np.ndarray, scores: np.ndarray, labels: np.ndarray, max_overlap: float) -> list[int]:
    """Of boxes of one label that overlap, keep the one with the best score (non-maximum suppression).

    Args:
        boxes: Top, bottom, left and right edges, shape (n, 4).
        scores: Their scores, shape (n,).
        labels: Their labels, shape (n,), int.
        max_overlap: Largest intersection / union with a better box of the same label.

    Returns:
        Indices of what is kept, best score first.
    """
    area = (boxes[:, 1] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 2])
    left = np.argsort(-scores, kind="stable")
    kept = []
    while left.size:
        best, left = int(left[0]), left[1:]
        kept.append(best)
        low = np.maximum(boxes[left][:, [0, 2]], boxes[best, [0, 2]])
        high = np.minimum(boxes[left][:, [1, 3]], boxes[best, [1, 3]])
        common = np.prod(np.maximum(high - low, 0.0), axis=1)
        overlap = common / np.maximum(area[left] + area[best] - common, 1e-9)
        left = left[(labels[left] != labels[best]) | (overlap <= max_overlap)]
    return kept
