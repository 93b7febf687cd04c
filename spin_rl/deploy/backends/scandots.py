"""Scandots for the robot in C MuJoCo: what a simulator knows of the obstacles, for policies that need it."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import warp as wp

from spin_rl import robot
from spin_rl.deploy.backends.motion import Movers
from spin_rl.deploy.contract import Contract
from spin_rl.scenes.layout import Scene
from spin_rl.scenes.scene_file import layout_from_scene
from spin_rl.sensors.scandots import Scandots
from spin_rl.warp_kernels.tokens import NUM_CORNERS, TOKEN_SIZE

_GROUP = "scandots"


class NativeScandots:
    """Tokens of one scene by the training's own sensor, from the poses of a C MuJoCo simulation."""

    def __init__(self, scene: Scene, model: mujoco.MjModel, contract: Contract) -> None:
        """Allocate the sensor's arrays, of one world on the CPU; compiles its kernel, once per machine."""
        assert contract.scandots is not None
        group = next(group for group in contract.observations if group.name == _GROUP)
        self._num_tokens = group.size // TOKEN_SIZE
        down, across = (math.tan(math.radians(fov) / 2) for fov in contract.camera.fov_deg)
        with wp.ScopedDevice("cpu"):
            self._poses = {
                "qpos": wp.zeros((1, model.nq), dtype=float),
                "site_xpos": wp.zeros((1, model.nsite), dtype=wp.vec3),
                "site_xmat": wp.zeros((1, model.nsite), dtype=wp.mat33),
            }
        self._layout = layout_from_scene(scene, 1, "cpu")
        self._sensor = Scandots(
            self._layout,
            **self._poses,
            camera_site=model.site(robot.CAMERA_SITE).id,
            tan_half_fov=(down, across),
            window=contract.scandots.window_m,
            near=contract.scandots.near_m,
            occlusion=contract.scandots.occlusion,
            pieces_from=contract.scandots.pieces_from_m,
        )

    def group(self, data: mujoco.MjData, movers: Movers) -> dict[str, np.ndarray]:
        """Return the observation group, its tokens with seen corners first, shape (1, size).

        A policy's tokens are a set. Where more are seen than it was trained with, the farthest are left out.
        """
        if len(movers.slots):
            pos = self._layout.pos.numpy()
            pos[0, movers.slots] = movers.pos
            self._layout.pos.assign(pos)
        for name, array in self._poses.items():
            values = getattr(data, name)
            array.assign(values.reshape(1, -1, 3, 3) if name == "site_xmat" else values[None])
        self._sensor.update()
        tokens = self._sensor.visible.numpy()[0]
        tokens = tokens[tokens[:, -NUM_CORNERS:].any(-1)]
        corners = tokens[:, :-NUM_CORNERS].reshape(len(tokens), NUM_CORNERS, 3)
        far = np.where(tokens[:, -NUM_CORNERS:] > 0, np.linalg.norm(corners, axis=-1), np.inf).min(-1)
        nearest = tokens[np.argsort(far, kind="stable")[: self._num_tokens]]
        told = np.zeros((self._num_tokens, TOKEN_SIZE), dtype=np.float32)
        told[: len(nearest)] = nearest
        return {_GROUP: told.reshape(1, -1)}
