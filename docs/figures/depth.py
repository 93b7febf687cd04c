"""Draw docs/figures/depth.png: what the depth camera sees of a corridor and of the robot itself.

Run from the repository root: ``python docs/figures/depth.py``.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from spin_rl import robot
from spin_rl.scenes.builder import native_model
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.sensors.depth.camera import DepthCamera

MAX_RANGE_M = 5.0
# Title, mount, joints.
VIEWS: tuple[tuple[str, robot.CameraMount, dict[str, float]], ...] = (
    ("driving: tilt -0.6", "portrait", {"head_tilt": -0.6}),
    ("ahead: tilt -0.2", "portrait", {"head_tilt": -0.2}),
    ("the arm, out to the right", "portrait", {"head_pan": -1.5, "head_tilt": -0.9, "arm_extension": 0.3}),
    ("the base: tilt -1.2", "portrait", {"head_tilt": -1.2}),
    ("landscape: tilt -0.6", "landscape", {"head_tilt": -0.6}),
)
# kind, centre, yaw, half size [m, rad].
SLOTS = [
    ("wall", (2.0, 0.85, 0.6), 0.0, (3.0, 0.05, 0.6)),
    ("wall", (2.0, -0.85, 0.6), 0.0, (3.0, 0.05, 0.6)),
    ("wall", (4.2, 0.0, 0.6), 0.0, (0.05, 0.9, 0.6)),
    ("box", (1.5, 0.45, 0.12), 0.4, (0.2, 0.25, 0.12)),
    ("box", (2.6, -0.3, 1.15), 0.0, (0.1, 0.45, 0.15)),
    ("box", (2.2, -0.6, 0.5), 0.3, (0.15, 0.15, 0.5)),
    ("cylinder", (1.7, -0.25, 0.35), 0.0, (0.13, 0.13, 0.35)),
]


def scene() -> Scene:
    """A corridor that ends, with an obstacle of each kind."""
    pool = PoolSpec()
    scene = Scene.empty(pool)
    free = {"wall": 0, "box": pool.first_box, "cylinder": pool.first_cylinder}
    for kind, pos, yaw, half_size in SLOTS:
        slot = free[kind]
        scene.pos[slot], scene.yaw[slot], scene.half_size[slot] = pos, yaw, half_size
        scene.active[slot] = True
        free[kind] += 1
    return scene


def render(mount: robot.CameraMount, joints: dict[str, float]) -> np.ndarray:
    """Depth [m] of one view, NaN where nothing is hit."""
    m = native_model(scene())
    d = mujoco.MjData(m)
    d.qpos[:] = robot.qpos_from_joints(m, {**robot.STOWED, **joints})
    mujoco.mj_kinematics(m, d)
    with wp.ScopedDevice("cpu"):
        model, data = mjw.put_model(m), mjw.put_data(m, d)
    camera = DepthCamera(
        m,
        model,
        data,
        camera_site=m.site("camera_depth_optical_frame").id,
        tan_half_fov=robot.camera_tan_half_fov(mount),
        max_range=MAX_RANGE_M,
    )
    camera.update()
    depth = camera.depth.numpy()[0]
    return np.where(depth > 0.0, depth, np.nan)


def main() -> None:
    """Write the figure beside this script."""
    tans = [robot.camera_tan_half_fov(mount) for _, mount, _ in VIEWS]
    figure, axes = plt.subplots(
        1, len(VIEWS), figsize=(13, 4.6), width_ratios=[tan[1] for tan in tans], layout="constrained"
    )
    for axis, (title, mount, joints), (down, right) in zip(axes, VIEWS, tans, strict=True):
        image = axis.imshow(
            render(mount, joints),
            extent=(-right, right, -down, down),
            vmin=0.0,
            vmax=MAX_RANGE_M,
            cmap="turbo_r",
            interpolation="nearest",
        )
        axis.set(title=title, xticks=[], yticks=[])
        axis.title.set_fontsize(10)
    figure.colorbar(image, ax=axes, label="z-depth [m]; white: nothing", shrink=0.8)
    figure.savefig(Path(__file__).with_suffix(".png"), dpi=90)


if __name__ == "__main__":
    main()
