"""The depth camera of a task: rendered, disturbed and filtered images as 8-bit observations."""

from __future__ import annotations

import torch
import warp as wp

from spin_rl import robot
from spin_rl.sensors.depth.camera import DepthCamera
from spin_rl.sensors.depth.pipeline import DepthConfig, DepthPipeline
from spin_rl.sensors.interface import Sensor
from spin_rl.sim.simulation import Simulation

_NEAREST_M = 0.05
"""Points nearer than this, or behind, are located as if they were here."""
MOST_OUTSIDE = 3.0
"""Points farther outside of the image are located here, in half images from its middle."""


class DepthImages(Sensor):
    """Owns camera and pipeline; see `Sensor`."""

    def __init__(
        self,
        sim: Simulation,
        cfg: DepthConfig,
        *,
        camera_mount: robot.CameraMount,
        seed: wp.array,
    ) -> None:
        """Allocate the images.

        Args:
            sim: The simulation; its poses are read at every update.
            cfg: Noise and filter.
            camera_mount: "portrait" or "landscape".
            seed: Random seed, shape (1,), int32.
        """
        camera_site = sim.mj_model.site(robot.CAMERA_SITE).id
        tan_half_fov = robot.camera_tan_half_fov(camera_mount)
        self.camera = DepthCamera(
            sim.mj_model, sim.model, sim.data, camera_site=camera_site, tan_half_fov=tan_half_fov
        )
        self.pipeline = DepthPipeline(self.camera.depth, cfg, tan_half_fov=tan_half_fov, seed=seed)
        self.camera.mount_pos = self.pipeline.noise.mount_pos
        self.camera.mount_rot = self.pipeline.noise.mount_rot
        self._policy = wp.to_torch(self.pipeline.policy).flatten(1)
        self._camera_pos, self._camera_mat = (
            wp.to_torch(poses)[:, camera_site] for poses in (sim.data.site_xpos, sim.data.site_xmat)
        )
        self._tan_half_fov = tan_half_fov
        self._range = (cfg.filter.near_m, cfg.filter.far_m)
        self._metres = wp.to_torch(self.pipeline.filter.depth).flatten(1)

    def begin(self, mask: wp.array) -> None:
        """Start a new episode in the masked worlds, shape (nworld,), bool; before `update`."""
        self.pipeline.begin(mask)

    def update(self) -> None:
        """Render and filter the images of all worlds, once in a control step, after the kinematics."""
        self.camera.update()
        self.pipeline.update()

    def observe(self, range_m: tuple[float, float] | None = None) -> torch.Tensor:
        """Return new images, row after row from the top, 0 (near) to 255, shape (num_envs, pixels), uint8.

        A quarter of the memory of 32-bit numbers, in rollouts that are kept to learn from; one step of 255
        is 15 mm in the range of 0.2 to 4 m.

        Args:
            range_m: Depths that become 0 and 255 [m]; None takes the filter's.
        """
        scaled = self._policy
        if range_m is not None:
            near, far = range_m
            scaled = ((self._metres - near) / (far - near)).clamp_(0.0, 1.0)
            scaled.masked_fill_(self._metres <= 0.0, 1.0)  # holes
        return (scaled * 255.0).add_(0.5).to(torch.uint8)

    def locate(self, point_w: torch.Tensor, range_m: tuple[float, float] | None = None) -> torch.Tensor:
        """Return where points are in the images, by the robot's own kinematics, shape (num_envs, 3).

        From -1 to 1 to the right and down, up to 3 in size beyond the edges, and the depth as `observe`
        scales it, 0 to 1 within the range. The camera's mounting error is not known.

        Args:
            point_w: World points [m], shape (num_envs, 3).
            range_m: As for `observe`.
        """
        x, y, z = (self._camera_mat * (point_w - self._camera_pos)[:, :, None]).sum(1).unbind(-1)
        near, far = self._range if range_m is None else range_m
        ahead = z.clamp(min=_NEAREST_M)
        down, right = x / (ahead * self._tan_half_fov[0]), -y / (ahead * self._tan_half_fov[1])
        return torch.stack(
            (*(v.clamp(-MOST_OUTSIDE, MOST_OUTSIDE) for v in (right, down)), (z - near) / (far - near)), -1
        )

    def set_episode(self, index: int) -> None:
        """Let the next reset draw the noise of the `index`-th episode of this seed in every world."""
        self.pipeline.noise.episode.fill_(index)

    @property
    def counter(self) -> torch.Tensor:
        """Episodes that every world has begun, a view, shape (num_envs,), int32."""
        return wp.to_torch(self.pipeline.noise.episode)
