"""The depth filter on the robot: one image at a time, NumPy in and out."""

from __future__ import annotations

import numpy as np
import warp as wp

from spin_rl.robot import CameraMount, is_portrait
from spin_rl.sensors.depth.filter import DepthFilter, DepthFilterConfig


class RobotDepthFilter:
    """The same filter for the images of one real camera: NumPy in, NumPy out.

    Attributes:
        depth: The last image, filtered [m], 0 where a hole is left, shape (rows, cols).
    """

    def __init__(
        self,
        config: DepthFilterConfig,
        shape: tuple[int, int] = (87, 58),
        *,
        mount: CameraMount = "portrait",
        device: str = "cpu",
    ) -> None:
        """Compile the kernels, which may take a minute the first time.

        Args:
            config: Steps; those that the policy was trained with.
            shape: Rows and columns of the policy's image, upright in the world.
            mount: How the camera is mounted, see `upright`.
            device: Warp device.

        Raises:
            ValueError: The mount is neither.
        """
        along_rows = not is_portrait(mount)
        self._mount: CameraMount = mount
        self._input = wp.zeros((1, *shape), dtype=float, device=device)
        self._filter = DepthFilter(self._input, config, stereo_along_rows=along_rows)
        self._all = wp.full(1, True, dtype=bool, device=device)
        self.depth = np.zeros(shape, dtype=np.float32)
        self._filter.update()
        self.reset()

    def reset(self) -> None:
        """Forget the past, at the start of an episode or after a pause."""
        self._filter.begin(self._all)

    def __call__(self, image: np.ndarray) -> np.ndarray:
        """Filter the next image of the camera's stream.

        Args:
            image: Depth [m] as the camera gives it, 0 or not finite where nothing was measured, of any size
                that is no smaller than the policy's; see `resample_depth`.

        Returns:
            The policy's input in [0, 1], of the policy's shape, float32.
        """
        self._input.assign(resample_depth(upright(image, self._mount), *self._input.shape[1:])[None])
        self._filter.update()
        self.depth = self._filter.depth.numpy()[0].copy()
        return self._filter.policy.numpy()[0].copy()


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
    measured = np.isfinite(values) & (values > 0.0)
    ordered = np.sort(np.where(measured, values, np.inf), axis=-1)
    middle = np.maximum(measured.sum(-1, keepdims=True) - 1, 0) // 2
    median = np.take_along_axis(ordered, middle, axis=-1)[..., 0]
    return np.where(np.isfinite(median), median, 0.0).astype(np.float32)
