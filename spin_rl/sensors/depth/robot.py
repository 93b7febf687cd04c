"""The depth filter on the robot: one image at a time, by NumPy alone.

The same steps as the kernels of `filter.DepthFilter`, which say where they come from; a test holds the two
together. Images are upright, in metres, with 0 for a hole.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from spin_rl.robot import CameraMount, is_portrait
from spin_rl.sensors.depth.filter_config import DepthFilterConfig


class RobotDepthFilter:
    """The simulation's filter for the images of one real camera: NumPy in, NumPy out.

    Attributes:
        depth: The last image, filtered [m], 0 where a hole is left, shape (rows, cols).
    """

    def __init__(
        self,
        config: DepthFilterConfig,
        shape: tuple[int, int] = (87, 58),
        *,
        mount: CameraMount = "portrait",
    ) -> None:
        """Start without a past.

        Args:
            config: Steps; those that the policy was trained with.
            shape: Rows and columns of the policy's image, upright in the world.
            mount: How the camera is mounted, see `upright`.

        Raises:
            ValueError: The mount is neither.
        """
        self._along_rows = not is_portrait(mount)
        self._config = config
        self._mount: CameraMount = mount
        self._shape = shape
        self.reset()

    def reset(self) -> None:
        """Forget the past, at the start of an episode or after a pause."""
        self.depth = np.zeros(self._shape, dtype=np.float32)
        self._age = np.zeros(self._shape, dtype=np.int32)

    def __call__(self, image: np.ndarray) -> np.ndarray:
        """Filter the next image of the camera's stream; see `reduce` and `update`."""
        return self.update(self.reduce(image))

    def reduce(self, image: np.ndarray) -> np.ndarray:
        """Turn a camera's own image upright and reduce it to the policy's shape.

        Args:
            image: Depth [m] as the camera gives it, 0 or not finite where nothing was measured, of any size
                that is no smaller than the policy's; see `resample_depth`.

        Returns:
            Depth [m], 0 where nothing was measured, of the policy's shape, float32.
        """
        return resample_depth(upright(image, self._mount), *self._shape)

    def update(self, measured: np.ndarray) -> np.ndarray:
        """Filter the next image.

        Args:
            measured: What `reduce` returned.

        Returns:
            The policy's input in [0, 1], of the policy's shape, float32.
        """
        config = self._config
        image = measured
        if config.dilate_px > 0:
            image = _fill(image, _nearest(image, _diamond(config.dilate_px)))
        if config.close_px > 0:
            image = _close(image, config.close_px) if self._along_rows else _close(image.T, config.close_px).T
        if config.fill_px > 0:
            reach = range(-config.fill_px, config.fill_px + 1)
            in_rows = _nearest(image, [(0, j) for j in reach])
            image = _fill(image, _nearest(in_rows, [(i, 0) for i in reach]))
        if config.blur > 0.0 or config.median_support > 0:
            image = _smooth(image, config)
        self._remember(image)
        scaled = (self.depth - np.float32(config.near_m)) / np.float32(config.far_m - config.near_m)
        return np.where(self.depth > 0.0, np.clip(scaled, 0.0, 1.0), np.float32(1.0))

    def _remember(self, image: np.ndarray) -> None:
        """Mix an image into `depth`, the past."""
        config, last = self._config, self.depth
        is_held = (image <= 0.0) & (last > 0.0) & (self._age < config.hold_steps)
        is_similar = (last > 0.0) & (np.abs(last - image) <= np.float32(config.memory_change) * image)
        mixed = np.where(is_similar, image + np.float32(config.memory) * (last - image), image)
        self.depth = np.where(is_held, last, mixed)
        self._age = np.where(is_held, self._age + 1, 0)


def upright(image: np.ndarray, mount: CameraMount) -> np.ndarray:
    """Turn a camera's own image upright.

    Args:
        image: Depth or colours as the camera gives them, shape (height, width, ...).
        mount: `portrait` where the camera's own image lies on its side: its right edge is down. `landscape`
            images are upright already.

    Returns:
        A view, shape (width, height, ...) in portrait.

    Raises:
        ValueError: The mount is neither.
    """
    return np.rot90(image, -1) if is_portrait(mount) else image


def resample_depth(image: np.ndarray, rows: int, cols: int, samples: int = 3) -> np.ndarray:
    """Reduce a depth image to a size: the median of some measured pixels from every block.

    A mean would invent depths between near and far. Of an even number of pixels the nearer middle one is
    taken.

    Args:
        image: Depth [m], 0 or not finite where nothing was measured, shape (n, m) with n >= rows, m >= cols.
        rows: Rows of the result.
        cols: Columns of the result.
        samples: Pixels taken of a block along either axis.

    Returns:
        Depth [m], 0 where none of the pixels was measured, shape (rows, cols), float32.

    Raises:
        ValueError: The image is not two-dimensional or smaller than the result.
    """
    if image.ndim != 2 or image.shape[0] < rows or image.shape[1] < cols:
        raise ValueError(f"the image must have at least {rows} x {cols} pixels, got {image.shape}")
    picks = [
        ((np.arange(small * samples) + 0.5) * (large / (small * samples))).astype(int)
        for small, large in ((rows, image.shape[0]), (cols, image.shape[1]))
    ]
    blocks = image[np.ix_(*picks)].reshape(rows, samples, cols, samples)
    values = blocks.transpose(0, 2, 1, 3).reshape(rows, cols, samples * samples).astype(np.float32)
    return _lower_median(values)


def _diamond(reach: int) -> list[tuple[int, int]]:
    around = range(-reach, reach + 1)
    return [(i, j) for i, j in itertools.product(around, around) if abs(i) + abs(j) <= reach]


def _shifted(image: np.ndarray, offsets: Sequence[tuple[int, int]]) -> list[np.ndarray]:
    """Return views of an image moved by rows and columns; beyond its edges there are holes."""
    rows, cols = image.shape
    reach = max(max(abs(i), abs(j)) for i, j in offsets)
    padded = np.pad(image, reach)
    return [padded[reach + i : reach + i + rows, reach + j : reach + j + cols] for i, j in offsets]


def _nearest(image: np.ndarray, offsets: Sequence[tuple[int, int]]) -> np.ndarray:
    """Return the nearest depth at some offsets of every pixel, 0 where all are holes."""
    far = np.where(image > 0.0, image, np.float32(np.inf))
    nearest = far.copy()
    rows, cols = image.shape
    for i, j in offsets:
        to_rows, to_cols = slice(max(-i, 0), rows - max(i, 0)), slice(max(-j, 0), cols - max(j, 0))
        from_rows, from_cols = slice(max(i, 0), rows + min(i, 0)), slice(max(j, 0), cols + min(j, 0))
        target = nearest[to_rows, to_cols]
        np.minimum(target, far[from_rows, from_cols], out=target)
    return np.where(np.isfinite(nearest), nearest, np.float32(0.0))


def _fill(image: np.ndarray, filling: np.ndarray) -> np.ndarray:
    return np.where(image > 0.0, image, filling)


def _close(image: np.ndarray, longest: int) -> np.ndarray:
    """Fill runs of at most so many holes in rows with the farther of the depths at their two ends."""
    (before, gap_before), (after, gap_after) = _last_measured(image), _last_measured(image[:, ::-1])
    after, gap_after = after[:, ::-1], gap_after[:, ::-1]
    # At every hole of a run, the distances to its two ends add up to the run's length plus one.
    filling = np.where(gap_before + gap_after <= longest + 1, np.maximum(before, after), np.float32(0.0))
    return _fill(image, filling)


def _last_measured(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the last depth at or before every pixel of a row, and how many pixels before it is."""
    column = np.arange(image.shape[1])
    last = np.maximum.accumulate(np.where(image > 0.0, column, -1), axis=1)
    depth = np.take_along_axis(image, np.maximum(last, 0), axis=1)
    never = 2 * image.shape[1]
    return np.where(last < 0, np.float32(0.0), depth), np.where(last < 0, never, column - last)


def _smooth(image: np.ndarray, config: DepthFilterConfig) -> np.ndarray:
    """Blur within surfaces; pixels with few neighbours on their own surface take the median around them."""
    offsets = list(itertools.product((-1, 0, 1), (-1, 0, 1)))
    neighbours = _shifted(image, offsets)
    tolerance = np.float32(config.surface_jump) * image
    total, weights = np.zeros_like(image), np.zeros_like(image)
    support = np.full(image.shape, -1, dtype=np.int32)  # without the pixel itself
    for (i, j), neighbour in zip(offsets, neighbours, strict=True):
        same = np.abs(neighbour - image) <= tolerance
        weight = np.where(same, np.float32(config.blur ** (abs(i) + abs(j))), np.float32(0.0))
        total += weight * neighbour
        weights += weight
        support += same
    result = total / weights
    lonely = np.nonzero((image > 0.0) & (support < config.median_support))
    around = np.stack([neighbour[lonely] for neighbour in neighbours], axis=-1)
    if around.size:
        result[lonely] = _lower_median(around)
    return result


def _lower_median(values: np.ndarray) -> np.ndarray:
    """Return the median of what was measured (finite, positive) along the last axis, 0 where nothing was.

    Of an even number of values the nearer middle one is taken.
    """
    measured = np.isfinite(values) & (values > 0.0)
    ordered = np.sort(np.where(measured, values, np.float32(np.inf)), axis=-1)
    middle = np.maximum(measured.sum(-1, keepdims=True) - 1, 0) // 2
    median = np.take_along_axis(ordered, middle, axis=-1)[..., 0]
    return np.where(np.isfinite(median), median, np.float32(0.0))
