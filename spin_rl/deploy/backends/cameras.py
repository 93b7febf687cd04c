"""The depth camera of the robot in C MuJoCo: by rays, or by MuJoCo's own renderer."""

from __future__ import annotations

import math
import os
from typing import Protocol

import mujoco
import numpy as np

from spin_rl import robot
from spin_rl.config import ConfigError
from spin_rl.deploy.backends.renderers import RAYS, RENDERED
from spin_rl.deploy.contract import Contract
from spin_rl.deploy.interface import CameraInfo

_FAR_M = 10.0
_NEAREST_M = 0.05
"""Nearest that the renderer draws."""
_SEEN_GROUPS = (0, 1, 2)
_HIDDEN_GROUP = 5
_CAMERA = "depth_camera"


class SimulatedCamera(Protocol):
    """A depth camera; what it is mounted on is not seen.

    Attributes:
        info: Its size, view and mount.
    """

    info: CameraInfo

    def image(self, data: mujoco.MjData) -> np.ndarray:
        """Depth [m], 0 where nothing is near enough, shape (height, width), float32; poses must be of now."""
        ...


def make_camera(
    model: mujoco.MjModel, contract: Contract, *, pixels: int | None = None, renderer: str = RAYS
) -> SimulatedCamera:
    """Make the camera of a policy; one that reads no images gets a coarse one.

    Args:
        model: The robot in its scene.
        contract: Of the policy.
        pixels: Columns of the camera's own image; None takes the policy's.
        renderer: One of `RENDERERS`.

    Raises:
        ConfigError: There is no OpenGL for `egl`.
    """
    wanted = contract.camera
    on_side = wanted.mount == "portrait"
    rows, columns = wanted.image or (29, 19)
    width, height = (rows, columns) if on_side else (columns, rows)
    if pixels is not None:
        height, width = max(round(pixels * height / width), 1), pixels
    fov = wanted.fov_deg if on_side else (wanted.fov_deg[1], wanted.fov_deg[0])
    info = CameraInfo(wanted.mount, width, height, fov)
    return _RayCamera(model, info) if renderer == RAYS else _RenderedCamera(model, info)


def _tangents(info: CameraInfo) -> tuple[float, float]:
    """Tangents of half the field of view, across and down the camera's own image."""
    across, down = (math.tan(math.radians(fov) / 2) for fov in info.fov_deg)
    return across, down


class _RayCamera:
    """One ray of `mj_multiRay` a pixel."""

    def __init__(self, model: mujoco.MjModel, info: CameraInfo) -> None:
        self.info = info
        self._model = model
        across, down = _tangents(info)
        u, v = (
            tan * ((2 * np.arange(n) + 1) / n - 1) for tan, n in ((across, info.width), (down, info.height))
        )
        right, below = np.meshgrid(u, v)
        if info.mount == "portrait":  # the site's axes are the camera's: x right, y down in its own image
            x, y = right, below
        else:  # as if it was turned: the site's x is down in the world, its y to the left
            x, y = below, -right
        # Rays advance one metre of depth per unit, so that distances are depths.
        self._rays = np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 3)
        self._groups = np.isin(np.arange(6), _SEEN_GROUPS).astype(np.uint8)
        self._geom = np.zeros(len(self._rays), dtype=np.int32)
        self._distance = np.zeros(len(self._rays))

    def image(self, data: mujoco.MjData) -> np.ndarray:
        site = data.site(robot.CAMERA_SITE)
        rays = self._rays @ site.xmat.reshape(3, 3).T
        mujoco.mj_multiRay(
            self._model,
            data,
            site.xpos,
            rays.ravel(),
            self._groups,
            True,
            self._model.site(robot.CAMERA_SITE).bodyid[0],
            self._geom,
            self._distance,
            None,
            len(rays),
            10.0 * _FAR_M,
        )
        depth = np.where((self._distance >= 0.0) & (self._distance <= _FAR_M), self._distance, 0.0)
        return depth.reshape(self.info.height, self.info.width).astype(np.float32)


class _RenderedCamera:
    """MuJoCo's renderer; changes the model's camera and what is drawn of its mount."""

    def __init__(self, model: mujoco.MjModel, info: CameraInfo) -> None:
        self.info = info
        self._on_side = info.mount == "portrait"
        tangents, size = _tangents(info), (info.width, info.height)
        across, down = tangents[::-1] if self._on_side else tangents
        width, height = size[::-1] if self._on_side else size
        camera = model.camera(_CAMERA).id
        # A focal length of 1 on a sensor as large as the view there: pixels need not be square.
        model.cam_sensorsize[camera] = 2.0 * across, 2.0 * down
        model.cam_intrinsic[camera] = 1.0, 1.0, 0.0, 0.0
        model.vis.map.znear, model.vis.map.zfar = (
            bound / model.stat.extent for bound in (_NEAREST_M, 2.0 * _FAR_M)
        )
        model.vis.global_.offwidth = max(model.vis.global_.offwidth, width)
        model.vis.global_.offheight = max(model.vis.global_.offheight, height)
        model.geom_group[model.geom_bodyid == model.cam_bodyid[camera]] = _HIDDEN_GROUP
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = np.isin(np.arange(6), _SEEN_GROUPS)
        # Without a display, MuJoCo's own choice of OpenGL ends the process.
        if os.environ.get("MUJOCO_GL") != RENDERED:
            raise ConfigError(f"renderer: {RENDERED} needs MUJOCO_GL={RENDERED} in the environment")
        try:
            self._renderer = mujoco.Renderer(model, height, width)
        except Exception as error:  # no common class: each platform of OpenGL has its own
            raise ConfigError(f"renderer: {RENDERED} cannot be used here: {error}") from None
        self._renderer.enable_depth_rendering()

    def image(self, data: mujoco.MjData) -> np.ndarray:
        self._renderer.update_scene(data, _CAMERA, self._option)
        depth = self._renderer.render()
        depth = np.where(depth <= _FAR_M, depth, 0.0).astype(np.float32)
        return depth[:, ::-1].T if self._on_side else depth
