"""The peers of the depth camera: C MuJoCo's `mj_multiRay` and `mujoco_warp.render`."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from spin_rl.sensors.depth.camera import DepthCamera
from spin_rl.sim.graph import StepGraph

# The geom groups that all of them draw.
_GROUPS = (0, 1, 2)


class NativeRays:
    """Casts one ray a pixel in ordinary MuJoCo models, one world after the other, on one core."""

    def __init__(
        self,
        worlds: Sequence[tuple[mujoco.MjModel, mujoco.MjData]],
        site: str,
        tan_half_fov: tuple[float, float],
        shape: tuple[int, int],
        max_range: float,
    ) -> None:
        """Prepare rays.

        Args:
            worlds: Models, and data with current poses.
            site: Name of the camera's optical frame; nothing of its own body is hit.
            tan_half_fov: Tangents of half the field of view along optical x and y.
            shape: Rows and columns.
            max_range: Largest depth seen [m]; rays end there.
        """
        self._worlds, self._site, self._shape, self._max_range = worlds, site, shape, max_range
        x, y = (tan * ((2 * np.arange(n) + 1) / n - 1) for tan, n in zip(tan_half_fov, shape, strict=True))
        rays = np.stack([*np.meshgrid(x, -y, indexing="ij"), np.ones(shape)], -1).reshape(-1, 3)
        self._length = np.linalg.norm(rays, axis=1)
        self._rays = rays / self._length[:, None]
        self._groups = np.isin(np.arange(6), _GROUPS).astype(np.uint8)
        self._geom = np.zeros(len(rays), dtype=np.int32)
        self._distance = np.zeros(len(rays))
        self._directions = [self._rays @ self._frame(d).T for _, d in worlds]

    def cast(self) -> None:
        """Cast the rays of all worlds; each world's distances replace the last one's."""
        for world in range(len(self._worlds)):
            self._cast(world)

    def images(self) -> np.ndarray:
        """z-depth [m], 0 where nothing is hit, shape (worlds, rows, columns)."""
        images = []
        for world in range(len(self._worlds)):
            self._cast(world)
            depth = self._distance / self._length
            images.append(np.where((depth >= 0.0) & (depth <= self._max_range), depth, 0.0))
        return np.reshape(images, (len(images), *self._shape))

    def _cast(self, world: int) -> None:
        m, d = self._worlds[world]
        mujoco.mj_multiRay(
            m,
            d,
            d.site(self._site).xpos,
            self._directions[world].ravel(),
            self._groups,
            True,
            m.site(self._site).bodyid[0] or -1,
            self._geom,
            self._distance,
            None,
            len(self._rays),
            self._max_range * self._length.max(),
        )

    def _frame(self, d: mujoco.MjData) -> np.ndarray:
        return d.site(self._site).xmat.reshape(3, 3)


class BatchRenderer:
    """`mujoco_warp.render`, depth only, in captured graphs.

    Attributes:
        render: Renders all worlds.
        refit_and_render: Fits its bounding volumes to the current poses before, which whatever moves needs.
    """

    render: Callable[[], None]
    refit_and_render: Callable[[], None]

    def __init__(
        self,
        mj_model: mujoco.MjModel,
        model: mjw.Model,
        data: mjw.Data,
        camera: str,
        tan_half_fov: tuple[float, float],
        shape: tuple[int, int],
    ) -> None:
        """Create its context with this field of view.

        Args:
            mj_model: The model; its camera's field of view is overwritten.
            model: Of all worlds.
            data: With current poses of cameras, too.
            camera: Name of a camera at the site's pose, upright.
            tan_half_fov: Tangents of half the field of view along optical x and y.
            shape: Rows and columns.
        """
        (rows, columns), index = shape, mj_model.camera(camera).id
        mj_model.cam_sensorsize[index] = columns, rows
        mj_model.cam_intrinsic[index] = columns / (2 * tan_half_fov[1]), rows / (2 * tan_half_fov[0]), 0, 0
        nworld, device = data.geom_xpos.shape[0], str(data.geom_xpos.device)
        self._shape = (nworld, rows, columns)
        with wp.ScopedDevice(device):
            self._context = mjw.create_render_context(
                mj_model,
                nworld=nworld,
                cam_active=[camera],
                cam_res=(columns, rows),
                render_rgb=False,
                render_depth=True,
                enabled_geom_groups=list(_GROUPS),
            )

            def render() -> None:
                mjw.render(model, data, self._context)

            def refit_and_render() -> None:
                mjw.refit_bvh(model, data, self._context)
                render()

            refit_and_render()  # compiles
            self.render = StepGraph(render, device).replay
            self.refit_and_render = StepGraph(refit_and_render, device).replay

    def images(self) -> np.ndarray:
        """z-depth [m] of the last rendering, 0 where nothing is hit, shape (nworld, rows, columns)."""
        return self._context.depth_data.numpy().reshape(self._shape)


def check_agreement(camera: DepthCamera, images: np.ndarray, max_range: float, peer: str) -> None:
    """Make sure that a peer draws the same: all pixels but a few at edges.

    Args:
        camera: The depth camera, updated.
        images: The peer's images of the first worlds [m].
        max_range: Largest depth of the camera [m].
        peer: Its name.

    Raises:
        RuntimeError: The images differ, so that their times cannot be compared.
    """
    theirs = np.where(images <= max_range, images, 0.0)
    different = np.abs(camera.depth.numpy()[: len(images)] - theirs) > 1e-3
    if different.mean() > 0.005:
        raise RuntimeError(f"the depth camera and {peer} differ in {different.mean():.1%} of the pixels")
