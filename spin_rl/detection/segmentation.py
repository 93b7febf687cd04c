"""The simulator's detector: where the depth camera shows a world's object, in all worlds at once."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco_warp as mjw
import numpy as np
import warp as wp

from spin_rl.sensors.depth.camera import DepthCamera
from spin_rl.warp_kernels.depth.targets import deproject_pixels, find_targets

CENTRE_OFFSET_M = {"banana": 0.019, "mug": 0.030, "can": 0.029, "brick": 0.020, "bottle": 0.043}
"""How far behind what is seen of it an object's centre is, along the line of sight; see docs/detection.md."""


class SegmentationDetector:
    """Finds each world's object in the camera's image and deprojects it.

    It stands for a perfect detector of the visible part of one object: no false alarms, hidden pixels do not
    count. As on the robot, the point is made of one pixel and one depth, and with the camera's pose by the
    robot's kinematics, which knows nothing of ``DepthCamera.mount_pos`` and ``mount_rot``.

    The point lies on the line of sight through the middle of what is seen, at the depth of the surface.
    ``centre_offset`` moves it from the surface to the object's centre.

    Source: SPIN paper, "Object Detection for Pick Policy".

    Attributes:
        geoms: The object's geoms in each world, shape (nworld, number of geoms), int32; -1 for none. May be
            written at any time, for instance when a world is reset.
        centre_offset: How far behind its surface the object's centre is, along the line of sight [m], shape
            (nworld,); 0 at first. May be written.
        visible: Whether enough pixels show the object and at least one of them has a depth, shape (nworld,),
            bool.
        num_pixels: How many pixels show it, shape (nworld,), int32.
        pixel: Their mean row and column, 0 without any, shape (nworld,), vec2.
        box: First row, end row, first column, end column of them, shape (nworld,), vec4i.
        depth: Median of their depths that were measured, 0 without any [m], shape (nworld,).
        point_b: The object in the base frame, 0 while it is not visible [m], shape (nworld,), vec3.
    """

    def __init__(
        self,
        camera: DepthCamera,
        data: mjw.Data,
        *,
        base_body: int,
        geoms: Sequence[int],
        measured: wp.array | None = None,
        min_pixels: int = 1,
    ) -> None:
        """Allocate the outputs and keep references to the arrays that ``update`` reads.

        Args:
            camera: Gives images, and where its geoms are in them.
            data: Gives the poses of camera and base.
            base_body: Index of the robot's base among the bodies.
            geoms: The object's geoms in all worlds, until ``geoms`` is written; -1 holds a place. The camera
                must draw them.
            measured: Images to take depths from in place of the camera's exact ones, for instance a
                ``DepthPipeline``'s with noise and holes [m], of the same shape.
            min_pixels: An object of fewer pixels is not visible.

        Raises:
            ValueError: Body or geoms do not exist, the images' shape differs, or min_pixels is not positive.
        """
        nworld, nbody = data.xpos.shape
        ngeom = data.geom_xpos.shape[1]
        if not 0 <= base_body < nbody:
            raise ValueError(f"base_body must be in [0, {nbody}), got {base_body}")
        if len(geoms) == 0 or not all(-1 <= geom < ngeom for geom in geoms):
            raise ValueError(f"geoms must be some in [-1, {ngeom}), got {list(geoms)}")
        if min_pixels < 1:
            raise ValueError(f"min_pixels must be positive, got {min_pixels}")
        self._measured = camera.depth if measured is None else measured
        if self._measured.shape != camera.depth.shape:
            raise ValueError(f"measured must be {camera.depth.shape}, got {self._measured.shape}")
        self._camera = camera
        self._data = data
        self._base_body = base_body
        self._min_pixels = min_pixels
        with wp.ScopedDevice(camera.depth.device):
            self.geoms = wp.array(np.tile(geoms, (nworld, 1)), dtype=wp.int32)
            self.centre_offset = wp.zeros(nworld, dtype=float)
            self.visible = wp.zeros(nworld, dtype=bool)
            self.num_pixels = wp.zeros(nworld, dtype=wp.int32)
            self.pixel = wp.zeros(nworld, dtype=wp.vec2)
            self.box = wp.zeros(nworld, dtype=wp.vec4i)
            self.depth = wp.zeros(nworld, dtype=float)
            self.point_b = wp.zeros(nworld, dtype=wp.vec3)
            self._every_world = wp.full(nworld, True, dtype=bool)
            self._slots = wp.zeros((nworld, len(geoms)), dtype=wp.int32)
            self._scratch = wp.zeros((nworld, camera.depth.size // nworld), dtype=float)

    def update(self, mask: wp.array | None = None) -> None:
        """Look at the camera's last images; graph-safe, and call it after the camera's ``update``.

        Args:
            mask: Worlds to look at, shape (nworld,), bool; what is known of the others stays. All by default.
        """
        mask = self._every_world if mask is None else mask
        find_targets(
            self._camera.buffers,
            self._camera.geoms,
            self._camera.depth,
            self._measured,
            self.geoms,
            mask,
            image=self._camera.image,
            min_pixels=self._min_pixels,
            scratch=self._scratch,
            slots_out=self._slots,
            num_pixels_out=self.num_pixels,
            pixel_out=self.pixel,
            box_out=self.box,
            depth_out=self.depth,
            visible_out=self.visible,
        )
        deproject_pixels(
            self.pixel,
            self.depth,
            self.visible,
            self.centre_offset,
            self._data.site_xpos,
            self._data.site_xmat,
            self._data.xpos,
            self._data.xmat,
            mask,
            camera_site=self._camera.camera_site,
            base_body=self._base_body,
            image=self._camera.image,
            point_out=self.point_b,
        )
