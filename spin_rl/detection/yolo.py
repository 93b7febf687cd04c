"""A detector from a YOLO-family network, exported to ONNX: weights are the user's own."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spin_rl.config import ConfigError
from spin_rl.detection.interface import Detection
from spin_rl.detection.yolo_boxes import decode, letterbox, suppress
from spin_rl.extras import require

_INPUT_TYPES = {"tensor(float)": np.float32, "tensor(float16)": np.float16}
_FREE_SIZE = 640  # of inputs whose shape the export left open


class YoloDetector:
    """Runs a network by onnxruntime (optional extra `detect`); a `Detector` that does not use the depth.

    Attributes:
        labels: Names of the kinds that the network knows, in its order.
        input_shape: Rows and columns of its input.
    """

    def __init__(
        self,
        path: str | Path,
        labels: Sequence[str] | None = None,
        *,
        min_score: float = 0.25,
        max_overlap: float = 0.45,
        input_shape: tuple[int, int] = (_FREE_SIZE, _FREE_SIZE),
        providers: Sequence[str] = ("CPUExecutionProvider",),
    ) -> None:
        """Load a network and try it on an empty image.

        Args:
            path: ONNX file: input (1, 3, rows, columns), red, green, blue in [0, 1]; first output as in
                ``yolo_boxes.decode``, exported without non-maximum suppression.
            labels: Names of all kinds in the network's order; by default those that the export wrote into the
                file, as YOLOv5 and Ultralytics' do.
            min_score: Least score of a detection.
            max_overlap: Largest intersection / union of two detections of one label.
            input_shape: Rows and columns of the input if the export left them open.
            providers: Where onnxruntime computes, by its names.

        Raises:
            ConfigError: onnxruntime is missing; the file is, or is no ONNX model; input, output or labels do
                not fit. One line.
        """
        if not 0.0 < min_score < 1.0 or not 0.0 < max_overlap <= 1.0:
            raise ConfigError(
                f"min_score must be in (0, 1) and max_overlap in (0, 1], got {min_score} and {max_overlap}"
            )
        self._path = Path(path)
        self._min_score = min_score
        self._max_overlap = max_overlap
        self._session = self._load(providers)
        self._input = self._session.get_inputs()[0]
        self.input_shape = self._check_input(input_shape)
        self.labels = tuple(labels) if labels is not None else self._written_labels()
        if not self.labels or len(set(self.labels)) < len(self.labels):
            raise self._error(f"labels must be names, all different, got {list(self.labels)}")
        self(np.zeros((*self.input_shape, 3), dtype=np.uint8), np.zeros(self.input_shape))

    def __call__(self, image: np.ndarray, depth: np.ndarray) -> list[Detection]:
        """Find objects; see `Detector`.

        Returns:
            Detections, best score first.

        Raises:
            ValueError: The image is not (rows, columns, 3) of uint8.
            ConfigError: The network's output does not fit the labels.
        """
        if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
            raise ValueError(f"image must be (rows, columns, 3) of uint8, got {image.shape} of {image.dtype}")
        tensor, placed = letterbox(image, self.input_shape)
        try:
            output = self._session.run(
                None, {self._input.name: tensor.astype(_INPUT_TYPES[self._input.type], copy=False)}
            )[0]
            boxes, scores = decode(np.asarray(output, dtype=np.float32), len(self.labels))
        except Exception as error:  # onnxruntime's exceptions have no common class of their own
            raise self._error(_first_line(error)) from error
        label = scores.argmax(axis=1)
        score = scores.max(axis=1)
        boxes = placed.to_image(boxes)
        likely = (score >= self._min_score) & (boxes[:, 0] < boxes[:, 1]) & (boxes[:, 2] < boxes[:, 3])
        boxes, score, label = boxes[likely], score[likely], label[likely]
        return [
            Detection(self.labels[label[i]], float(score[i]), tuple(boxes[i].tolist()))
            for i in suppress(boxes, score, label, self._max_overlap)
        ]

    def _error(self, message: str) -> ConfigError:
        return ConfigError(f"{self._path}: {message}")

    def _load(self, providers: Sequence[str]) -> Any:
        onnxruntime = require("onnxruntime", "onnxruntime", "detect", "the YOLO detector")
        if not self._path.is_file():
            raise self._error("no such file")
        available = onnxruntime.get_available_providers()
        if not providers or not set(providers) <= set(available):
            raise ConfigError(f"providers: choose from {', '.join(available)}, got {list(providers)}")
        try:
            return onnxruntime.InferenceSession(str(self._path), providers=list(providers))
        except Exception as error:
            raise self._error(f"onnxruntime cannot load it: {_first_line(error)}") from error

    def _check_input(self, free_shape: tuple[int, int]) -> tuple[int, int]:
        inputs = self._session.get_inputs()
        shape = list(self._input.shape)
        fits = len(inputs) == 1 and len(shape) == 4 and self._input.type in _INPUT_TYPES
        # Dimensions that the export left open are names or None.
        if not fits or any(isinstance(n, int) and n != m for n, m in zip(shape[:2], (1, 3), strict=True)):
            found = ", ".join(f"{i.type} {i.shape}" for i in inputs)
            raise self._error(f"needs one input of floats [1, 3, rows, columns], has {found}")
        rows, columns = (
            n if isinstance(n, int) else free for n, free in zip(shape[2:], free_shape, strict=True)
        )
        return rows, columns

    def _written_labels(self) -> tuple[str, ...]:
        text = self._session.get_modelmeta().custom_metadata_map.get("names")
        if text is None:
            raise self._error("labels: the file has none; give the names of all kinds in the network's order")
        try:
            names = ast.literal_eval(text)
            values = [names[i] for i in range(len(names))]
        except (ValueError, SyntaxError, KeyError, TypeError):
            raise self._error(f"labels: cannot read those in the file: {text[:80]!r}") from None
        return tuple(str(name) for name in values)


def _first_line(error: Exception) -> str:
    return str(error).strip().split("\n", 1)[0]
