"""The depth camera: what a pinhole depth camera at a site sees of the scene and of the robot."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from spin_rl.sensors.depth.size import PIXELS
from spin_rl.warp_kernels.depth.draw import draw_depth
from spin_rl.warp_kernels.depth.records import DepthBuffers, project_geoms
from spin_rl.warp_kernels.depth.screen import make_image
from spin_rl.warp_kernels.depth.shapes import LANES

SOLID_TYPES = tuple(
    int(kind)
    for kind in (
        mujoco.mjtGeom.mjGEOM_PLANE,
        mujoco.mjtGeom.mjGEOM_SPHERE,
        mujoco.mjtGeom.mjGEOM_CAPSULE,
        mujoco.mjtGeom.mjGEOM_ELLIPSOID,
        mujoco.mjtGeom.mjGEOM_CYLINDER,
        mujoco.mjtGeom.mjGEOM_BOX,
    )
)
"""Geom types that can be drawn."""

_LAST_SHOWN_GROUP = 2


class DepthCamera:
    """Renders the depth images of all worlds from the simulator's own arrays.

    The site's optical frame has z forward and x down in the world, in portrait and in landscape alike. Rows
    run along optical x and columns against optical y, so that the image is upright: row 0 at the top, column
    0 at the left. Depth is measured along the optical axis, not along the ray. Poses and sizes of the geoms
    are read by every ``update``, so that obstacles may move.

    Attributes:
        buffers: What the two halves of `update` share.
        camera_site: Index of the camera's optical frame among the sites.
        geoms: Geoms that are drawn, shape (nslot,), int32.
        image: Pixels and field of view, as kernels read them.
        depth: z-depth [m], 0 where nothing is hit within the largest range, shape (nworld, rows, columns).
        mount_pos: Error of the camera's mounting: its shift in the site's frame [m], shape (nworld,), vec3.
        mount_rot: Likewise its turn, from the camera's actual frame to the site's, shape (nworld,), mat33.
            Both may be written or, before a graph is captured, replaced by arrays of another owner.
    """

    def __init__(
        self,
        mj_model: mujoco.MjModel,
        model: mjw.Model,
        data: mjw.Data,
        *,
        camera_site: int,
        tan_half_fov: tuple[float, float],
        shape: tuple[int, int] | None = None,
        max_range: float = 10.0,
        geoms: Sequence[int] | None = None,
        by_pixel: bool | None = None,
    ) -> None:
        """Allocate the images and keep references to the arrays that ``update`` reads.

        Args:
            mj_model: The model that ``model`` was made of.
            model: Gives the geoms' types and sizes.
            data: Gives poses of geoms and sites, and the number of worlds and the device.
            camera_site: Index of the camera's optical frame among the sites.
            tan_half_fov: Tangents of half the field of view along optical x (rows) and y (columns).
            shape: Rows and columns; by default `PIXELS` along the longer and the shorter side.
            max_range: Largest depth seen [m].
            geoms: Geoms to draw; by default `visible_geoms`.
            by_pixel: How to divide the work, see ``draw_depth``; by default what suits the device.

        Raises:
            ValueError: A length, field of view or shape is not positive, site or geoms do not exist, a geom
                is of a type that cannot be drawn, or the image is too narrow for ``by_pixel=False``.
        """
        if shape is None:
            shape = PIXELS if tan_half_fov[0] >= tan_half_fov[1] else (PIXELS[1], PIXELS[0])
        if min(tan_half_fov) <= 0.0 or max_range <= 0.0 or min(shape) < 1:
            raise ValueError(
                "tan_half_fov, max_range and shape must be positive, "
                f"got {tan_half_fov}, {max_range}, {shape}"
            )
        if not 0 <= camera_site < mj_model.nsite:
            raise ValueError(f"camera_site must be in [0, {mj_model.nsite}), got {camera_site}")
        narrow = shape[1] < LANES
        if narrow and by_pixel is False:
            raise ValueError(f"by_pixel=False needs at least {LANES} columns, got {shape[1]}")
        chosen = visible_geoms(mj_model, camera_site) if geoms is None else list(geoms)
        _check_geoms(mj_model, chosen)
        nworld, device = data.geom_xpos.shape[0], data.geom_xpos.device
        self._model = model
        self._data = data
        self.camera_site = camera_site
        self.image = make_image(shape, tan_half_fov, max_range)
        self._by_pixel = (device.is_cuda or narrow) if by_pixel is None else by_pixel
        self.buffers = DepthBuffers.create(nworld, len(chosen), device)
        with wp.ScopedDevice(device):
            self.geoms = wp.array(chosen, dtype=wp.int32)
            self._every_world = wp.full(nworld, True, dtype=bool)
            self.mount_pos = wp.zeros(nworld, dtype=wp.vec3)
            self.mount_rot = wp.full(nworld, wp.mat33(np.eye(3)), dtype=wp.mat33)
            self.depth = wp.zeros((nworld, *shape), dtype=float)

    def update(self, mask: wp.array | None = None) -> None:
        """Render from the current poses; graph-safe, and call it after the kinematics.

        Args:
            mask: Worlds to render, shape (nworld,), bool; the images of the others stay as they are. All by
                default.
        """
        self.project(mask)
        self.draw(mask)

    def project(self, mask: wp.array | None = None) -> None:
        """First half of `update`: find the geoms in view and where they are in the image."""
        project_geoms(
            self._data.geom_xpos,
            self._data.geom_xmat,
            self._model.geom_size,
            self._model.geom_type,
            self.geoms,
            self._data.site_xpos,
            self._data.site_xmat,
            self.mount_pos,
            self.mount_rot,
            self._every_world if mask is None else mask,
            camera_site=self.camera_site,
            image=self.image,
            buffers_out=self.buffers,
        )

    def draw(self, mask: wp.array | None = None) -> None:
        """Second half of `update`: the images."""
        draw_depth(
            self.buffers,
            self._every_world if mask is None else mask,
            image=self.image,
            by_pixel=self._by_pixel,
            depth_out=self.depth,
        )


def visible_geoms(mj_model: mujoco.MjModel, camera_site: int) -> list[int]:
    """Geoms that a camera at a site shows: those of the groups 0 to 2 on other bodies than the site's.

    These are the groups that MuJoCo's viewers show at first. Of the robot they hold the visual shape. Its
    collision shape (group 3) is rounded up around it, so that the fingers would look three times as thick as
    they are, and has the camera inside of one geom. The camera's own body lies behind its lens.
    """
    own = mj_model.site_bodyid[camera_site]
    foreign = (mj_model.geom_bodyid != own) | (own == 0)
    return np.flatnonzero(foreign & (mj_model.geom_group <= _LAST_SHOWN_GROUP)).tolist()


def _check_geoms(mj_model: mujoco.MjModel, geoms: list[int]) -> None:
    if not geoms:
        raise ValueError("geoms: at least one is needed")
    for geom in geoms:
        if not 0 <= geom < mj_model.ngeom:
            raise ValueError(f"geoms must be in [0, {mj_model.ngeom}), got {geom}")
        if mj_model.geom_type[geom] not in SOLID_TYPES:
            kind = mujoco.mjtGeom(mj_model.geom_type[geom]).name.removeprefix("mjGEOM_").lower()
            raise ValueError(f"geom {mj_model.geom(geom).name!r} is a {kind}, which the camera cannot draw")
