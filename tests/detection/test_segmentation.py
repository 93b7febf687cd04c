"""The simulator's detector on the robot: kinematics, camera and detector of the batched simulation."""

import mujoco
import numpy as np
import pytest
import warp as wp

from spin_rl import robot
from spin_rl.deploy.kinematics import Kinematics
from spin_rl.detection.deproject import Intrinsics, locate
from spin_rl.detection.interface import Detection
from spin_rl.detection.segmentation import SegmentationDetector
from spin_rl.scenes.builder import native_model
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.sensors.depth.camera import DepthCamera
from spin_rl.sim.config import SimConfig
from spin_rl.sim.simulation import Simulation

POOL = PoolSpec()
# Where the can stands in the base frame, and where the robot stands: the camera looks over its right side.
CANS = ((0.35, -0.7, 0.6), (0.1, -0.8, 0.5))
STARTS = ((0.3, -0.2, 0.9), (-1.0, 0.5, -2.0))
JOINTS = ({"head_pan": -1.2, "head_tilt": -0.6}, {"head_pan": -1.5, "head_tilt": -0.8, "lift": 0.8})
CAN_HALF_SIZE = (0.034, 0.034, 0.051)


def scene(can_b, start, joints) -> Scene:
    """A can on a table, seen from the side."""
    scene = Scene.empty(POOL)
    x, y, yaw = start
    can = np.array(
        [np.cos(yaw) * can_b[0] - np.sin(yaw) * can_b[1], np.sin(yaw) * can_b[0] + np.cos(yaw) * can_b[1], 0]
    )
    can += x, y, can_b[2]
    table = can[2] - CAN_HALF_SIZE[2]
    box, cylinder = POOL.first_box, POOL.first_cylinder
    for slot, pos, half_size in (
        (cylinder, can, CAN_HALF_SIZE),
        (box, (can[0], can[1], table / 2), (0.2, 0.2, table / 2)),
    ):
        scene.pos[slot], scene.half_size[slot], scene.active[slot] = pos, half_size, True
    scene.start = np.array(start)
    pose = {**robot.STOWED, **joints}
    scene.start_joints = np.array([pose[name] for name in robot.JOINTS])
    return scene


@pytest.fixture(scope="module", params=["portrait", "landscape"])
def seen(request, device):
    """Two worlds with a can at different places, looked at."""
    scenes = [scene(*some) for some in zip(CANS, STARTS, JOINTS, strict=True)]
    sim = Simulation(len(scenes), POOL, robot.SPEED_PROFILES["paper"], SimConfig(substeps=2), device)
    for world, some in enumerate(scenes):
        sim.layout.load(some, world)
    m = sim.mj_model
    tan = robot.camera_tan_half_fov(request.param)
    with wp.ScopedDevice(device):
        sim.reset(wp.full(sim.nworld, True, dtype=bool))
        sim.forward()
        site = m.site(robot.CAMERA_SITE).id
        camera = DepthCamera(m, sim.model, sim.data, camera_site=site, tan_half_fov=tan)
        camera.update()
        detector = SegmentationDetector(
            camera, sim.data, base_body=m.body("base").id, geoms=[m.geom("cylinder_0").id]
        )
    detector.update()
    return scenes, camera, detector, Intrinsics.from_fov(camera.depth.shape[1:], tan)


def test_pixels_and_point_as_c_mujoco_has_them(seen):
    """Rays by `mj_multiRay`, the base's frame by C MuJoCo's kinematics."""
    scenes, _, detector, intrinsics = seen
    rows, columns = np.meshgrid(*(np.arange(n) for n in intrinsics.shape), indexing="ij")
    rays = intrinsics.rays(np.stack([rows, columns], axis=-1)).reshape(-1, 3)
    length = np.linalg.norm(rays, axis=1)
    for world, some in enumerate(scenes):
        m = native_model(some)
        d = mujoco.MjData(m)
        d.qpos[:] = robot.qpos_from_joints(m, dict(zip(robot.JOINTS, some.start_joints, strict=True)))
        d.qpos[:3] = some.start
        mujoco.mj_kinematics(m, d)
        site, base = d.site(robot.CAMERA_SITE), d.body("base")
        mat = site.xmat.reshape(3, 3)
        geom, distance = np.full(len(rays), -1, dtype=np.int32), np.zeros(len(rays))
        groups, body = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8), m.site_bodyid[site.id]
        unit = (rays / length[:, None]) @ mat.T
        mujoco.mj_multiRay(
            m,
            d,
            site.xpos,
            unit.ravel(),
            groups,
            True,
            body,
            geom,
            distance,
            None,
            len(rays),
            mujoco.mjMAXVAL,
        )
        shown = geom == m.geom("cylinder_0").id
        assert detector.visible.numpy()[world] and 10 < shown.sum()
        assert detector.num_pixels.numpy()[world] == pytest.approx(shown.sum(), abs=1)
        pixel = np.array([rows.ravel()[shown].mean(), columns.ravel()[shown].mean()])
        np.testing.assert_allclose(detector.pixel.numpy()[world], pixel, atol=0.1)
        z = np.median((distance / length)[shown])
        point = base.xmat.reshape(3, 3).T @ (site.xpos + mat @ (z * intrinsics.rays(pixel)) - base.xpos)
        np.testing.assert_allclose(detector.point_b.numpy()[world], point, atol=2e-3)


def test_offset_leads_to_the_centre(seen):
    """The surface is nearer by about the can's radius; the offset makes up for it."""
    *_, detector, _ = seen
    errors = []
    for offset in (0.0, 0.03):
        detector.centre_offset.fill_(offset)
        detector.update()
        errors.append(np.linalg.norm(detector.point_b.numpy() - CANS, axis=1))
    assert (errors[0] > 0.02).all() and (errors[0] < 0.045).all()
    assert (errors[1] < 0.012).all()
    detector.centre_offset.zero_()
    detector.update()


def test_robots_own_way_gives_the_same_point(seen):
    """A detection of the same box, located from the depth image and the joints alone.

    The box's middle is not the pixels' mean: that makes up to a pixel, 2 cm at 1 m.
    """
    scenes, camera, detector, intrinsics = seen
    kinematics = Kinematics()
    for world, some in enumerate(scenes):
        pose = kinematics(some.start_joints)[robot.CAMERA_SITE]
        detection = Detection("can", 1.0, tuple(detector.box.numpy()[world].tolist()))
        point = locate(detection, camera.depth.numpy()[world], intrinsics, pose)
        assert point is not None
        np.testing.assert_allclose(detector.point_b.numpy()[world], point, atol=0.02)


def test_mounting_errors_are_not_known_to_it(seen):
    """A camera that sits 3 cm further back sees the can further away, and so it is believed to be."""
    *_, camera, detector, _ = seen
    before = detector.point_b.numpy().copy()
    camera.mount_pos.assign(np.array([[0, 0, -0.03], [0, 0, 0]], dtype=np.float32))
    camera.update()
    detector.update()
    moved = np.linalg.norm(detector.point_b.numpy() - before, axis=1)
    camera.mount_pos.zero_()
    camera.update()
    detector.update()
    assert moved[0] == pytest.approx(0.03, abs=0.006) and moved[1] == 0.0
