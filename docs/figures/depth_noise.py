"""Draws docs/figures/depth_noise.png: exact, measured and filtered depth images of two scenes.

Needs the extra ``plots``. The exact images are C MuJoCo's rays; noise and filter are the ones of training.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import matplotlib.pyplot as plt
import mujoco
import numpy as np
import warp as wp
import yaml
from matplotlib.axes import Axes

from spin_rl import robot
from spin_rl.config import from_mapping
from spin_rl.paths import CONF_DIR
from spin_rl.scenes.builder import native_model
from spin_rl.scenes.scene_file import parse_scene
from spin_rl.sensors.depth.pipeline import DepthConfig, DepthPipeline

ROWS, COLS = 87, 58
FRAMES = 5
PAN_PER_FRAME = 0.02
"""How far the head turns between two frames [rad]: 0.2 rad/s at ten frames a second."""

WALLS = [
    {"position": [3.0, 0.55], "size": [7.0, 0.1, 1.5]},
    {"position": [3.0, -0.55], "size": [7.0, 0.1, 1.5]},
    {"position": [6.5, 0.0], "size": [0.1, 1.2, 1.5]},
]
SCENES = {
    "Cluttered corridor": {
        "boxes": [
            {"position": [1.4, 0.3], "size": [0.35, 0.3, 0.2], "yaw": 0.3},
            {"position": [2.2, -0.25, 0.6], "size": [0.3, 0.5, 0.2]},
            {"position": [3.3, 0.2, 1.2], "size": [0.3, 0.6, 0.3]},
        ],
        "cylinders": [{"position": [1.8, -0.3], "radius": 0.1, "height": 0.25}],
    },
    "Thin obstacles": {
        "boxes": [{"position": [1.9, 0.2, 0.75], "size": [0.04, 0.6, 0.04]}],
        "cylinders": [
            {"position": [1.2, -0.2], "radius": 0.02, "height": 1.1},
            {"position": [1.6, 0.25], "radius": 0.02, "height": 0.5},
        ],
    },
}


def rays(tan_half_fov: tuple[float, float]) -> np.ndarray:
    """Directions through the pixels' centres in the optical frame, depth 1, shape (ROWS * COLS, 3).

    Upright: rows along optical x, which points down, columns against optical y, which points to the left.
    """
    x = tan_half_fov[0] * ((np.arange(ROWS) + 0.5) * 2.0 / ROWS - 1.0)
    y = -tan_half_fov[1] * ((np.arange(COLS) + 0.5) * 2.0 / COLS - 1.0)
    grid = np.meshgrid(x, y, indexing="ij")
    return np.stack([*grid, np.ones((ROWS, COLS))], axis=-1).reshape(-1, 3)


def exact_image(model: mujoco.MjModel, pan: float, tan_half_fov: tuple[float, float]) -> np.ndarray:
    """Depth [m] from the robot at the origin, 0 where nothing is hit, shape (ROWS, COLS)."""
    data = mujoco.MjData(model)
    joints = {**robot.STOWED, "head_pan": pan, "head_tilt": -0.45}
    data.qpos[:] = robot.qpos_from_joints(model, joints)
    mujoco.mj_forward(model, data)
    camera = data.site("camera_depth_optical_frame")
    directions = rays(tan_half_fov)
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    directions_w = directions / lengths @ camera.xmat.reshape(3, 3).T
    distance = np.zeros(len(directions))
    geom = np.zeros(len(directions), dtype=np.int32)
    groups = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)  # scene, floor and the robot's visual shape
    own_body = model.site("camera_depth_optical_frame").bodyid[0]
    rays_w = directions_w.ravel()
    mujoco.mj_multiRay(
        model, data, camera.xpos, rays_w, groups, 1, own_body, geom, distance, None, ROWS * COLS, 100.0
    )
    depth = np.where(geom >= 0, distance / lengths[:, 0], 0.0)
    return depth.reshape(ROWS, COLS).astype(np.float32)


def run(content: dict) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Exact, measured and filtered image [m] after a few frames of a turning head."""
    tan_half_fov = robot.camera_tan_half_fov("portrait")
    scene = parse_scene({"start": {"position": [0, 0]}, "goal": [5, 0], "walls": WALLS, **content})
    model = native_model(scene)
    config = from_mapping(
        DepthConfig, yaml.safe_load((CONF_DIR / "depth" / "d435i.yaml").read_text()), "depth"
    )
    config = dataclasses.replace(config, noise=dataclasses.replace(config.noise, latency_steps=(0, 0)))
    ideal = wp.zeros((1, ROWS, COLS), dtype=float, device="cpu")
    seed = wp.array([4], dtype=wp.int32, device="cpu")
    pipeline = DepthPipeline(ideal, config, tan_half_fov=tan_half_fov, seed=seed)
    pipeline.begin(wp.full(1, True, dtype=bool, device="cpu"))
    for frame in range(FRAMES):
        image = exact_image(model, PAN_PER_FRAME * (frame - FRAMES + 1), tan_half_fov)
        ideal.assign(image[None])
        pipeline.update()
    return image, pipeline.noise.depth.numpy()[0], pipeline.filter.depth.numpy()[0]


def draw(axes: Axes, image: np.ndarray, title: str) -> plt.cm.ScalarMappable:
    """Show an image, holes in pink."""
    colors = plt.get_cmap("viridis_r").copy()
    colors.set_bad("#ff3bd4")
    shown = axes.imshow(
        np.ma.masked_equal(image, 0.0), cmap=colors, vmin=0.3, vmax=4.0, interpolation="nearest"
    )
    axes.set(xticks=[], yticks=[], title=title)
    return shown


def main() -> None:
    """Write the figure beside this script."""
    figure, axes = plt.subplots(1, 6, figsize=(13, 3.8), constrained_layout=True)
    for index, (name, content) in enumerate(SCENES.items()):
        images = run(content)
        for column, (image, what) in enumerate(zip(images, ("exact", "measured", "filtered"), strict=True)):
            shown = draw(axes[3 * index + column], image, what)
        axes[3 * index].set_xlabel(name, loc="left")
    figure.colorbar(shown, ax=axes, label="depth [m]", shrink=0.8)
    figure.savefig(Path(__file__).with_suffix(".png"), dpi=110)


if __name__ == "__main__":
    main()
