"""How far the simulator's detector is off: prints the table of docs/detection.md.

    PYTHONPATH=. python docs/figures/detector_error.py

Every kind of object stands on a table at 300 random places in front of the camera, which looks at it from
above as the robot's does. Nothing hides it.
"""

from __future__ import annotations

from types import SimpleNamespace

import mujoco
import numpy as np
import warp as wp

from spin_rl import robot
from spin_rl.detection.segmentation import SegmentationDetector
from spin_rl.scenes.objects.shapes import KINDS, OBJECT_BODY, add_native_object
from spin_rl.sensors.depth.camera import DepthCamera

PLACES = 300
CAMERA_HEIGHT_M = 1.3
SHAPES = ((87, 58), (348, 232))


def place(kind: str, rng: np.random.Generator) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return a world with the object on a table before a camera that looks about at it."""
    half = np.array(KINDS[kind].half_extents)
    table = rng.uniform(0.5, 0.8)
    centre = np.array([rng.uniform(0.4, 1.0), rng.uniform(-0.2, 0.2), table + half[2]])
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX, pos=[0.9, 0.0, table - 0.02], size=[0.8, 0.6, 0.02]
    )
    add_native_object(spec, kind, half, 0.1)
    # The pan and tilt that look at it, off by up to 0.2 rad: z forward, x down.
    eye = np.array([0.0, 0.0, CAMERA_HEIGHT_M])
    tilt = np.arctan2(centre[2] - eye[2], centre[0]) + rng.uniform(-0.2, 0.2)
    pan = np.arctan2(centre[1], centre[0]) + rng.uniform(-0.2, 0.2)
    forward = np.array([np.cos(tilt) * np.cos(pan), np.cos(tilt) * np.sin(pan), np.sin(tilt)])
    left = np.array([-np.sin(pan), np.cos(pan), 0.0])
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, np.stack([np.cross(left, forward), left, forward], axis=1).ravel())
    spec.worldbody.add_site(pos=eye, quat=quat)
    m = spec.compile()
    d = mujoco.MjData(m)
    yaw = rng.uniform(-np.pi, np.pi)
    d.joint(OBJECT_BODY).qpos[:] = [*centre, np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)]
    mujoco.mj_kinematics(m, d)
    return m, d


def look(worlds: list[tuple[mujoco.MjModel, mujoco.MjData]], shape: tuple[int, int]) -> SegmentationDetector:
    """Return what the detector sees in worlds of one kind; the base frame is the world's."""
    m = worlds[0][0]

    def batch(name: str, dtype: type) -> wp.array:
        values = np.array([getattr(d, name) for _, d in worlds], dtype=np.float32)
        return wp.array(values.reshape(*values.shape[:2], *dtype._shape_), dtype=dtype, device="cpu")

    vectors, matrices = ("geom_xpos", "site_xpos", "xpos"), ("geom_xmat", "site_xmat", "xmat")
    poses = {name: batch(name, wp.vec3) for name in vectors} | {
        name: batch(name, wp.mat33) for name in matrices
    }
    model = SimpleNamespace(
        geom_size=wp.array(m.geom_size[None].astype(np.float32), dtype=wp.vec3, device="cpu"),
        geom_type=wp.array(m.geom_type, dtype=wp.int32, device="cpu"),
    )
    data = SimpleNamespace(**poses)
    tan = robot.camera_tan_half_fov("portrait")
    camera = DepthCamera(m, model, data, camera_site=0, tan_half_fov=tan, shape=shape)
    camera.update()
    geoms = np.flatnonzero(m.geom_bodyid == m.body(OBJECT_BODY).id).tolist()
    detector = SegmentationDetector(camera, data, base_body=0, geoms=geoms)
    detector.update()
    return detector


def main() -> None:
    """Print, per kind and image, the best offset and what is left of the error with it."""
    print("| Object | Image | Pixels | Error | Best `centre_offset` | Error with it | 95 % of errors |")
    print("|---|---|---|---|---|---|---|")
    for kind in KINDS:
        rng = np.random.default_rng(0)
        worlds = [place(kind, rng) for _ in range(PLACES)]
        centres = np.array([d.body(OBJECT_BODY).xpos for _, d in worlds])
        eyes = np.array([d.site_xpos[0] for _, d in worlds])
        for shape in SHAPES:
            detector = look(worlds, shape)
            seen = detector.visible.numpy()
            points, pixels = detector.point_b.numpy()[seen], detector.num_pixels.numpy()[seen]
            rays = points - eyes[seen]
            rays /= np.linalg.norm(rays, axis=1, keepdims=True)
            missing = centres[seen] - points
            offset = float((missing * rays).sum(1).mean())
            errors = np.linalg.norm(missing, axis=1)
            left = np.linalg.norm(missing - offset * rays, axis=1)
            lengths = errors.mean(), offset, left.mean(), np.percentile(left, 95)
            columns = [kind, f"{shape[0]} x {shape[1]}", f"{np.median(pixels):.0f}"]
            print("|", " | ".join(columns + [f"{1e3 * length:.0f} mm" for length in lengths]), "|")


if __name__ == "__main__":
    main()
