"""Pictures of a stage by ray casting on the CPU with mujoco_warp: no OpenGL, no display."""

from __future__ import annotations

import mujoco_warp as mjw
import numpy as np
import warp as wp

from spin_rl.scenes.builder import SCENE_GROUP
from spin_rl.viewer import style
from spin_rl.viewer.camera import PinholeCamera
from spin_rl.viewer.stage import VIEW, VISUAL_GROUP, Stage


class Renderer:
    """Renders a stage's following camera, with shadows and smoothed edges, and with walls cut low."""

    def __init__(self, stage: Stage, width: int, height: int, samples: int = 2) -> None:
        """Allocate the picture; the first `render` compiles the kernel.

        Args:
            stage: What to render.
            width: Columns.
            height: Rows.
            samples: Rays per pixel along each axis.
        """
        self._stage = stage
        self._size = (width, height)
        red, green, blue = style.PAPER
        with wp.ScopedDevice("cpu"):
            # Colours and sizes change with the scene: these rows are this renderer's own.
            self._model = mjw.put_model(stage.model, batch_sizes={"geom_size": 1, "geom_rgba": 1})
            self._data = mjw.make_data(stage.model, nworld=1)
            self._context = mjw.create_render_context(
                stage.model,
                nworld=1,
                cam_res=self._size,
                cam_active=[VIEW],
                render_rgb=True,
                use_shadows=True,
                samples_per_pixel=samples,
                enabled_geom_groups=[SCENE_GROUP, VISUAL_GROUP],
                background_color=(red / 255, green / 255, blue / 255, 1.0),
            )

    def render(self) -> np.ndarray:
        """Return the picture of the stage's present pose, shape (height, width, 3), uint8."""
        stage, data = self._stage, self._data
        xpos, size = stage.low_walls()
        values = {
            "geom_xpos": xpos,
            "geom_xmat": stage.data.geom_xmat.reshape(-1, 3, 3),
            "cam_xpos": stage.data.cam_xpos,
            "cam_xmat": stage.data.cam_xmat.reshape(-1, 3, 3),
            "light_xpos": stage.data.light_xpos,
            "light_xdir": stage.data.light_xdir,
        }
        for name, value in values.items():
            getattr(data, name).assign(value[None].astype(np.float32))
        self._model.geom_size.assign(size[None].astype(np.float32))
        self._model.geom_rgba.assign(stage.model.geom_rgba[None])
        with wp.ScopedDevice("cpu"):
            mjw.refit_bvh(self._model, data, self._context)
            mjw.render(self._model, data, self._context)
        packed = self._context.rgb_data.numpy()[0].reshape(self._size[::-1])
        return np.stack([(packed >> shift) & 0xFF for shift in (16, 8, 0)], -1).astype(np.uint8)

    def camera(self) -> PinholeCamera:
        """The camera of the picture, to draw over it."""
        stage = self._stage
        camera = stage.model.camera(VIEW).id
        return PinholeCamera(
            pos=stage.data.cam_xpos[camera].copy(),
            mat=stage.data.cam_xmat[camera].reshape(3, 3).copy(),
            fovy=float(stage.model.cam_fovy[camera]),
            width=self._size[0],
            height=self._size[1],
        )
