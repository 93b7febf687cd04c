"""Scenes with the robot, and their depth images by C MuJoCo, for the tests of the depth camera.

``PYTHONPATH=. python tests/sensors/depth_scenes.py`` writes the golden images, tests/data/depth_golden.npy.
They are made by MuJoCo's rays alone, and tell whether scene, robot, camera or conventions have changed.
"""

from pathlib import Path

import mujoco
import numpy as np

from spin_rl import robot
from spin_rl.scenes.builder import native_model
from spin_rl.scenes.layout import PoolSpec, Scene

GOLDEN = Path(__file__).parents[1] / "data" / "depth_golden.npy"
POOL = PoolSpec()
SITE = "camera_depth_optical_frame"
# Ahead and down, as in driving; and over the right side, where the arm is out.
POSES = ({"head_tilt": -0.6}, {"head_pan": -1.5, "head_tilt": -0.9, "lift": 0.6, "arm_extension": 0.3})


def scene(shift=0.0, **joints) -> Scene:
    """A corridor 1.2 m wide with two boxes, one above the floor, and a cylinder."""
    scene = Scene.empty(POOL)
    box, cylinder = POOL.first_box, POOL.first_cylinder
    for slot, pos, half_size in (
        (0, (2.0, 0.65 + shift, 0.6), (3.0, 0.05, 0.6)),
        (1, (2.0, -0.65 + shift, 0.6), (3.0, 0.05, 0.6)),
        (2, (4.0, 0.0, 0.6), (0.05, 0.8, 0.6)),
        (box, (1.2, 0.3, 0.1), (0.15, 0.25, 0.1)),
        (box + 1, (1.9, -0.3, 1.1), (0.1, 0.3, 0.15)),
        (cylinder, (1.5, -0.35, 0.45), (0.12, 0.12, 0.45)),
    ):
        scene.pos[slot], scene.half_size[slot], scene.active[slot] = pos, half_size, True
    scene.yaw[box] = 0.4
    pose = {**robot.STOWED, **joints}
    scene.start_joints = np.array([pose[name] for name in robot.JOINTS])
    return scene


def native(scene: Scene):
    """C MuJoCo's model and data of a scene, the robot at its start."""
    m = native_model(scene)
    d = mujoco.MjData(m)
    d.qpos[:] = robot.qpos_from_joints(m, dict(zip(robot.JOINTS, scene.start_joints, strict=True)))
    d.qpos[:3] = scene.start
    mujoco.mj_kinematics(m, d)
    return m, d


def native_depth(m, d, tan, shape, max_range=10.0, shift=0.0) -> np.ndarray:
    """z-depth by one `mj_ray` per pixel; `shift` moves all of them to the side and down."""
    site = m.site(SITE).id
    groups = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
    geom, depth = np.zeros(1, dtype=np.int32), np.zeros(shape)
    for row, column in np.ndindex(shape):
        x = tan[0] * ((2 * row + 1) / shape[0] - 1) + shift
        y = -tan[1] * ((2 * column + 1) / shape[1] - 1) + shift
        ray = d.site_xmat[site].reshape(3, 3) @ [x, y, 1.0]
        hit = mujoco.mj_ray(m, d, d.site_xpos[site], ray, groups, 1, m.site_bodyid[site], geom)
        depth[row, column] = hit if 0.0 <= hit <= max_range else 0.0
    return depth


def main() -> None:
    """Write the golden images."""
    tan = robot.camera_tan_half_fov("portrait")
    images = [native_depth(*native(scene(**pose)), tan, (87, 58)) for pose in POSES]
    np.save(GOLDEN, np.array(images, dtype=np.float32))


if __name__ == "__main__":
    main()
