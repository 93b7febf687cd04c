"""From exact depth images to the policy's input: noise, latency, filter, in the order of a real camera."""

from __future__ import annotations

from dataclasses import dataclass, field

import warp as wp

from spin_rl.sensors.depth.filter import DepthFilter
from spin_rl.sensors.depth.filter_config import DepthFilterConfig
from spin_rl.sensors.depth.noise import DepthNoise, DepthNoiseConfig


@dataclass(frozen=True)
class DepthConfig:
    """What happens to a depth image on its way to the policy; the configuration group `depth`.

    Attributes:
        noise: Effects of the camera; simulation only.
        filter: Post-processing; the same on the robot.
    """

    noise: DepthNoiseConfig = field(default_factory=DepthNoiseConfig)
    filter: DepthFilterConfig = field(default_factory=DepthFilterConfig)


class DepthPipeline:
    """Runs noise and filter one after the other, inside the captured step.

    Attributes:
        noise: The measured images and the camera's mount of every episode.
        filter: The filtered images and the policy's input.
    """

    def __init__(
        self, ideal: wp.array, config: DepthConfig, *, tan_half_fov: tuple[float, float], seed: wp.array
    ) -> None:
        """Allocate the buffers; arguments as of `DepthNoise`. Call `begin` for all worlds before `update`."""
        self.noise = DepthNoise(ideal, config.noise, tan_half_fov=tan_half_fov, seed=seed)
        self.filter = DepthFilter(
            self.noise.depth, config.filter, stereo_along_rows=tan_half_fov[1] > tan_half_fov[0]
        )

    @property
    def policy(self) -> wp.array:
        """The policy's input in [0, 1], shape (nworld, rows, cols)."""
        return self.filter.policy

    def begin(self, mask: wp.array) -> None:
        """Start a new episode in the masked worlds, before its first image is rendered; graph-safe.

        Args:
            mask: Worlds to restart, shape (nworld,), bool.
        """
        self.noise.begin(mask)
        self.filter.begin(mask)

    def update(self) -> None:
        """Measure and filter the current images, once in a control step after the rendering; graph-safe."""
        self.noise.update()
        self.filter.update()
