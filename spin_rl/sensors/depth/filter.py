# pyright: reportGeneralTypeIssues=false
# (a Warp struct is an object, not a class, to a type checker)
"""Post-processing of depth images, shared by simulation and robot: filling, smoothing, temporal filter."""

from __future__ import annotations

import math

import warp as wp

from spin_rl.sensors.depth.filter_config import DepthFilterConfig
from spin_rl.warp_kernels.images import (
    frames as depth_images,
)
from spin_rl.warp_kernels.images import (
    holes as depth_holes,
)
from spin_rl.warp_kernels.images import (
    smoothing as depth_smoothing,
)


class DepthFilter:
    """Fills, smooths and scales the depth images of all worlds, inside the captured step.

    The configuration is frozen when a graph is captured.

    Attributes:
        depth: Filtered images [m], 0 where a hole is left, shape (nworld, rows, cols).
        policy: The policy's input, `(depth - near) / (far - near)` clipped to [0, 1], 1 where a hole is left,
            shape (nworld, rows, cols).
    """

    def __init__(
        self, measured: wp.array, config: DepthFilterConfig, *, stereo_along_rows: bool = True
    ) -> None:
        """Allocate the buffers and keep a reference to the images that `update` reads.

        Args:
            measured: Depth [m], 0 where there is a hole, shape (nworld, rows, cols), contiguous. For a Torch
                tensor pass `wp.from_torch(tensor)`.
            config: Steps.
            stereo_along_rows: Whether the camera's two imagers lie beside each other along the image's rows,
                as in a landscape mount, or along its columns.

        Raises:
            ValueError: The images are not of three dimensions.
        """
        if measured.ndim != 3:
            raise ValueError(f"depth images must have the shape (nworld, rows, cols), got {measured.shape}")
        self._config = config
        self._num_worlds, self._rows, self._cols = measured.shape
        self._device = wp.get_device(measured.device)
        self._lines = depth_images.image_lines(self._rows, self._cols, along_rows=stereo_along_rows)
        self._smoothing = _smoothing(config)
        self._memory = _memory(config)
        self._lanes = 1 if self._device.is_cuda else depth_images.LANES
        # A thread of the CPU does a row's worth of pixels, one of CUDA a pixel.
        self._run = 1 if self._device.is_cuda else self._cols
        self._measured = measured.flatten()
        with wp.ScopedDevice(self._device):
            self._buffers = [wp.zeros(measured.size, dtype=float) for _ in range(3)]
            self._age = wp.zeros(measured.size, dtype=wp.int32)
            self._frame = wp.zeros(self._num_worlds, dtype=wp.int32)
            self.depth = wp.zeros(measured.shape, dtype=float)
            self.policy = wp.zeros(measured.shape, dtype=float)
        self._history = self.depth.flatten()
        self._policy = self.policy.flatten()

    def begin(self, mask: wp.array) -> None:
        """Forget the past of the masked worlds; graph-safe.

        Args:
            mask: Worlds that start a new episode, shape (nworld,), bool.
        """
        wp.launch(
            depth_images.restart_frames,
            dim=self._num_worlds,
            inputs=[mask],
            outputs=[self._frame],
            device=self._device,
        )

    def update(self) -> None:
        """Filter the current images, once in a control step; graph-safe."""
        config, device, run = self._config, self._device, self._run
        rows, cols = self._rows, self._cols
        image = self._measured
        first, second, third = self._buffers
        if config.dilate_px > 0:
            image = self._dilate(image, image, first, config.dilate_px, config.dilate_px, is_diamond=True)
        if config.close_px > 0:
            wp.launch(
                depth_holes.close_lines,
                dim=(self._num_worlds, math.ceil(self._lines.count / self._lanes)),
                inputs=[image, self._lines, self._lanes, config.close_px, third],
                outputs=[second],
                device=device,
            )
            image = second
        if config.fill_px > 0:
            # A square is a row's dilation by a column's.
            spread = self._dilate(image, image, third, 0, config.fill_px, keep=False)
            image = self._dilate(image, spread, first, config.fill_px, 0)
        if config.blur > 0.0 or config.median_support > 0:
            wp.launch(
                depth_smoothing.smooth_pixels,
                dim=(self._num_worlds, rows, math.ceil(cols / self._lanes)),
                inputs=[image, rows, cols, self._lanes, self._smoothing],
                outputs=[third],
                device=device,
            )
            image = third
        wp.launch(
            depth_smoothing.remember_pixels,
            dim=(self._num_worlds, rows * cols // run),
            inputs=[image, rows * cols, run, self._memory, self._frame, self._age, self._history],
            outputs=[self._policy],
            device=device,
        )
        wp.launch(depth_images.count_frames, dim=self._num_worlds, inputs=[self._frame], device=device)

    def _dilate(
        self,
        image: wp.array,
        around: wp.array,
        result: wp.array,
        reach_rows: int,
        reach_cols: int,
        *,
        is_diamond: bool = False,
        keep: bool = True,
    ) -> wp.array:
        """Write the nearest depth of `around` in a window into holes, or all pixels if not `keep`."""
        wp.launch(
            depth_holes.dilate,
            dim=(self._num_worlds, self._rows, math.ceil(self._cols / self._lanes)),
            inputs=[
                image,
                around,
                self._rows,
                self._cols,
                self._lanes,
                reach_rows,
                reach_cols,
                is_diamond,
                keep,
            ],
            outputs=[result],
            device=self._device,
        )
        return result


def _smoothing(config: DepthFilterConfig) -> depth_smoothing.Smoothing:
    smoothing = depth_smoothing.Smoothing()
    smoothing.jump = config.surface_jump
    smoothing.support = config.median_support
    smoothing.blur = config.blur
    return smoothing


def _memory(config: DepthFilterConfig) -> depth_smoothing.Memory:
    memory = depth_smoothing.Memory()
    memory.weight = config.memory
    memory.change = config.memory_change
    memory.hold = config.hold_steps
    memory.near = config.near_m
    memory.far = config.far_m
    return memory
