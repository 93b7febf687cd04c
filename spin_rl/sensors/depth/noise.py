# pyright: reportGeneralTypeIssues=false
# (a Warp struct is an object, not a class, to a type checker)
"""Realism of the simulated depth camera: what a stereo camera like the D435i does to an exact depth image."""

from __future__ import annotations

import math
from dataclasses import dataclass

import warp as wp

from spin_rl.warp_kernels.images import frames as depth_images
from spin_rl.warp_kernels.images import noise as kernels

MOST_PATCHES = 1000
MOST_LATENCY_STEPS = 50


@dataclass(frozen=True)
class DepthNoiseConfig:
    """Effects of the camera; each is off at zero, and all are by default. docs/depth_camera.md has sources.

    Attributes:
        min_range_m: Smallest depth that is measured [m]; nearer is a hole.
        max_range_m: Largest depth that is measured [m]; farther is a hole.
        shadow_baseline_m: Distance of the two imagers [m]: what the right one does not see is a hole.
        edge_jump: Share of itself by which the inverse depth must bend at a pixel to make it an edge.
        edge_dropout: Probability of a hole at a pixel beside an edge.
        flying_pixels: Probability that a pixel beside an edge lies between the depths of both sides.
        noise_per_m: Standard deviation of the inverse depth [1/m]; a depth's is this times its square [m].
        noise_correlation: Correlation of the noise of neighbours along the baseline.
        step_per_m: Quantum of the inverse depth [1/m], from the quantum of the disparity.
        dropout: Probability of a hole at any pixel.
        patches: Holes of many pixels in every frame.
        patch_radius_px: Largest half axis of such a hole [pixel].
        latency_steps: Range of the delay, drawn per episode [control steps].
        mount_rotation_deg: Largest turn of the mounted camera about each optical axis, drawn per episode.
        mount_translation_m: Largest shift of the mounted camera along each optical axis, drawn per episode.
    """

    min_range_m: float = 0.0
    max_range_m: float = 0.0
    shadow_baseline_m: float = 0.0
    edge_jump: float = 0.1
    edge_dropout: float = 0.0
    flying_pixels: float = 0.0
    noise_per_m: float = 0.0
    noise_correlation: float = 0.0
    step_per_m: float = 0.0
    dropout: float = 0.0
    patches: int = 0
    patch_radius_px: float = 4.0
    latency_steps: tuple[int, int] = (0, 0)
    mount_rotation_deg: float = 0.0
    mount_translation_m: float = 0.0

    def __post_init__(self) -> None:
        """Reject impossible values with the key's name."""
        for name in (
            "min_range_m",
            "max_range_m",
            "shadow_baseline_m",
            "noise_per_m",
            "step_per_m",
            "patches",
        ):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ValueError(f"depth.noise.{name} must be at least 0, got {value}")
        for name in ("edge_dropout", "flying_pixels", "noise_correlation", "dropout"):
            value = getattr(self, name)
            if not 0.0 <= value < 1.0:
                raise ValueError(f"depth.noise.{name} must be in [0, 1), got {value}")
        if 0.0 < self.max_range_m <= self.min_range_m:
            raise ValueError(f"depth.noise.max_range_m must exceed min_range_m, got {self.max_range_m}")
        if not 0.0 < self.edge_jump < math.inf:
            raise ValueError(f"depth.noise.edge_jump must be positive, got {self.edge_jump}")
        if self.patches > MOST_PATCHES:
            raise ValueError(f"depth.noise.patches must be at most {MOST_PATCHES}, got {self.patches}")
        if not 1.0 <= self.patch_radius_px <= 1000.0:
            raise ValueError(
                f"depth.noise.patch_radius_px must be at least 1 and at most 1000, got {self.patch_radius_px}"
            )
        low, high = self.latency_steps
        if not 0 <= low <= high <= MOST_LATENCY_STEPS:
            raise ValueError(
                f"depth.noise.latency_steps must be 0 <= low <= high <= {MOST_LATENCY_STEPS}, "
                f"got [{low}, {high}]"
            )
        if not 0.0 <= self.mount_rotation_deg <= 45.0:
            raise ValueError(
                f"depth.noise.mount_rotation_deg must be in [0, 45], got {self.mount_rotation_deg}"
            )
        if not 0.0 <= self.mount_translation_m <= 0.5:
            raise ValueError(
                f"depth.noise.mount_translation_m must be in [0, 0.5], got {self.mount_translation_m}"
            )


class DepthNoise:
    """Turns exact depth images into measured ones, inside the captured step.

    Random numbers depend on the seed, the world, its episode and its frame only: worlds are independent, and
    a reset of one leaves the others' numbers alone. The configuration is frozen when a graph is captured.

    Attributes:
        depth: Measured images, delayed by the world's latency [m], 0 where there is a hole, shape (nworld,
            rows, cols).
        latency: Delay of the current episode [control steps], shape (nworld,), int32.
        mount_pos: Shift of the camera in its nominal optical frame [m], shape (nworld,), vec3.
        mount_rot: Turn of the camera, from the actual to the nominal optical frame, shape (nworld,), mat33.
        episode: Episodes begun so far, shape (nworld,), int32; zero it, or set it, to repeat random numbers.
    """

    def __init__(
        self,
        ideal: wp.array,
        config: DepthNoiseConfig,
        *,
        tan_half_fov: tuple[float, float],
        seed: wp.array,
    ) -> None:
        """Allocate the buffers and keep a reference to the images that `update` reads.

        Call `begin` for all worlds before the first `update`.

        Args:
            ideal: Exact z-depth [m], 0 where a ray hits nothing, shape (nworld, rows, cols), contiguous. For
                a Torch tensor pass `wp.from_torch(tensor)`.
            config: Effects.
            tan_half_fov: Tangents of half the field of view along optical x (rows) and y (columns), as of
                `DepthCamera`. The imagers lie beside each other along the wider one, the right one towards
                larger rows or columns.
            seed: Random seed, shape (1,), int32; read at every launch.

        Raises:
            ValueError: The images are not of three dimensions, or the field of view is not positive.
        """
        if ideal.ndim != 3:
            raise ValueError(f"depth images must have the shape (nworld, rows, cols), got {ideal.shape}")
        if min(tan_half_fov) <= 0.0:
            raise ValueError(f"tan_half_fov must be positive, got {tan_half_fov}")
        self._config = config
        self._seed = seed
        self._num_worlds, rows, cols = ideal.shape
        self._device = wp.get_device(ideal.device)
        self._ideal = ideal.flatten()
        self._lines = depth_images.image_lines(rows, cols, along_rows=tan_half_fov[1] > tan_half_fov[0])
        self._lanes = 1 if self._device.is_cuda else depth_images.LANES
        self._errors = _stereo_errors(config, focal_px=self._lines.length / (2.0 * max(tan_half_fov)))
        n = self._num_worlds
        with wp.ScopedDevice(self._device):
            self.depth = wp.zeros(ideal.shape, dtype=float)
            self._flat = self.depth.flatten()
            self._num_slots = config.latency_steps[1] + 1
            self._ring = wp.zeros(n * self._num_slots * rows * cols, dtype=float)
            self.latency = wp.zeros(n, dtype=wp.int32)
            self.episode = wp.zeros(n, dtype=wp.int32)
            self._frame = wp.zeros(n, dtype=wp.int32)
            self.mount_pos = wp.zeros(n, dtype=wp.vec3)
            self.mount_rot = wp.zeros(n, dtype=wp.mat33)

    def begin(self, mask: wp.array) -> None:
        """Start a new episode in the masked worlds: no history, new latency and mount; graph-safe.

        Call it before the image of the new episode is rendered, which depends on the mount.

        Args:
            mask: Worlds to restart, shape (nworld,), bool.
        """
        config = self._config
        wp.launch(
            kernels.begin_episodes,
            dim=self._num_worlds,
            inputs=[
                mask,
                self._seed,
                *config.latency_steps,
                math.radians(config.mount_rotation_deg),
                config.mount_translation_m,
                self.episode,
            ],
            outputs=[self._frame, self.latency, self.mount_pos, self.mount_rot],
            device=self._device,
        )

    def update(self) -> None:
        """Measure the current images, once in a control step after the rendering; graph-safe."""
        config = self._config
        wp.launch(
            kernels.measure_lines,
            dim=(self._num_worlds, math.ceil(self._lines.count / self._lanes)),
            inputs=[
                self._ideal,
                self._lines,
                self._lanes,
                self._errors,
                self._seed,
                self.episode,
                self._frame,
                self.latency,
                self._num_slots,
                self._ring,
            ],
            outputs=[self._flat],
            device=self._device,
        )
        if config.patches > 0:
            wp.launch(
                kernels.punch_patches,
                dim=(self._num_worlds, config.patches),
                inputs=[
                    self._lines,
                    config.patches,
                    config.patch_radius_px,
                    self._seed,
                    self.episode,
                    self._frame,
                    self.latency,
                    self._num_slots,
                    self._ring,
                    self._flat,
                ],
                device=self._device,
            )
        wp.launch(depth_images.count_frames, dim=self._num_worlds, inputs=[self._frame], device=self._device)


def _stereo_errors(config: DepthNoiseConfig, focal_px: float) -> kernels.StereoErrors:
    errors = kernels.StereoErrors()
    errors.min_range = config.min_range_m
    errors.max_range = config.max_range_m
    errors.disparity = config.shadow_baseline_m * focal_px
    # Looking for edges costs time, so that nothing looks for them in vain.
    has_edges = config.edge_dropout > 0.0 or config.flying_pixels > 0.0
    errors.edge_jump = config.edge_jump if has_edges else 0.0
    errors.edge_dropout = config.edge_dropout
    errors.flying = config.flying_pixels
    errors.noise = config.noise_per_m
    errors.memory = config.noise_correlation
    errors.step = config.step_per_m
    errors.dropout = config.dropout
    return errors
