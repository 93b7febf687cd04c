"""Pixels to points: the camera model against C MuJoCo's frames and the simulator's images."""

import mujoco
import numpy as np
import pytest

from spin_rl import robot
from spin_rl.deploy.kinematics import Frame, Kinematics
from spin_rl.detection.deproject import (
    Intrinsics,
    deproject,
    locate,
    robust_depth,
)
from spin_rl.detection.interface import Detection, best_of
from spin_rl.sensors.depth.robot import upright

MOUNTS = ("portrait", "landscape")
SHAPES = {"portrait": (87, 58), "landscape": (58, 87)}
AHEAD = Frame(np.zeros(3), np.eye(3))


def intrinsics(mount="portrait") -> Intrinsics:
    return Intrinsics.from_fov(SHAPES[mount], robot.camera_tan_half_fov(mount))


@pytest.mark.parametrize("mount", MOUNTS)
def test_pixels_look_where_the_depth_camera_says(mount):
    """The formula of docs/kernels.md."""
    rows, columns = SHAPES[mount]
    tan = robot.camera_tan_half_fov(mount)
    i, j = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    expected = tan[0] * (2 * (i + 0.5) / rows - 1), -tan[1] * (2 * (j + 0.5) / columns - 1)
    rays = intrinsics(mount).rays(np.stack([i, j], axis=-1))
    np.testing.assert_allclose(rays[..., 0], expected[0], atol=1e-12)
    np.testing.assert_allclose(rays[..., 1], expected[1], atol=1e-12)
    np.testing.assert_array_equal(rays[..., 2], 1.0)


def test_deprojection_undoes_projection():
    rng = np.random.default_rng(0)
    camera = Intrinsics((480, 848), (430.0, 441.0), (233.5, 420.25))
    for point in rng.uniform([-1, -1, 0.3], [1, 1, 4], (20, 3)):
        pixel = camera.project(point)
        np.testing.assert_allclose(deproject(tuple(pixel), point[2], camera), point, atol=1e-12)
        further = deproject(tuple(pixel), point[2], camera, offset=0.05)
        np.testing.assert_allclose(further, point * (1 + 0.05 / np.linalg.norm(point)), atol=1e-12)


@pytest.mark.parametrize("mount", MOUNTS)
def test_calibration_of_the_cameras_own_image(mount):
    """A point's own pixel, painted there, is in the upright image where the upright camera projects it.

    The camera's own frame has x along its columns and y along its rows. In portrait it is the site's; in
    landscape the site has x down and y to the left.
    """
    width, height, focal, centre = 64, 40, (50.0, 47.0), (30.0, 21.0)
    camera = Intrinsics.from_calibration(width, height, focal, centre, mount)
    own = np.array([0.2, -0.11, 1.3])
    column, row = (round(focal[a] * own[a] / own[2] + centre[a]) for a in range(2))
    image = np.zeros((height, width))
    image[row, column] = 1.0
    turned = upright(image, mount)
    assert turned.shape == camera.shape
    in_site = own if mount == "portrait" else np.array([own[1], -own[0], own[2]])
    np.testing.assert_allclose(camera.project(in_site), np.argwhere(turned)[0], atol=0.5)


def camera_pose(joints):
    return Kinematics()(np.array([joints[name] for name in robot.JOINTS]))[robot.CAMERA_SITE]


def test_camera_pose_is_that_of_the_robots_site():
    """Seen from the base: C MuJoCo's robot stands somewhere, the other one at the origin."""
    m = robot.load_spec().compile()
    d = mujoco.MjData(m)
    joints = {**robot.STOWED, "head_pan": -1.2, "head_tilt": -0.9, "lift": 0.7}
    d.qpos[:] = robot.qpos_from_joints(m, joints)
    d.qpos[:3] = 1.0, -2.0, 0.8
    mujoco.mj_kinematics(m, d)
    base, site = d.body("base"), d.site(robot.CAMERA_SITE)
    turn = base.xmat.reshape(3, 3)
    pose = camera_pose(joints)
    np.testing.assert_allclose(pose.pos, turn.T @ (site.xpos - base.xpos), atol=1e-12)
    np.testing.assert_allclose(pose.mat, turn.T @ site.xmat.reshape(3, 3), atol=1e-12)
    ahead = site.xpos + 2.0 * site.xmat.reshape(3, 3)[:, 2]
    expected = turn.T @ (ahead - base.xpos)
    np.testing.assert_allclose(pose.to_base(np.array([0.0, 0.0, 2.0])), expected, atol=1e-12)


def scene(background=3.0) -> np.ndarray:
    """An object 1 m away in rows 20-39 and columns 10-29, a background elsewhere."""
    depth = np.full((87, 58), background)
    depth[20:40, 10:30] = 1.0
    return depth


BOX = (20.0, 40.0, 10.0, 30.0)


def test_depth_of_a_box_ignores_holes_and_its_margin():
    depth = scene()
    depth[20:25] = depth[35:40] = 3.0
    assert robust_depth(depth, BOX) == 1.0
    depth[25:35, 15:20] = 0.0
    depth[25:35, 20:22] = np.nan
    assert robust_depth(depth, BOX) == 1.0
    depth[25:35, 22:30] = 0.0
    assert robust_depth(depth, BOX) == 0.0
    assert robust_depth(depth, BOX, share=1.0) == 3.0


@pytest.mark.parametrize(
    "box, pixel",
    [((30.2, 30.4, 12.1, 12.3), (30, 12)), ((-4.0, 1.0, 55.0, 80.0), (0, 57)), ((86, 87, 57, 58), (86, 57))],
)
def test_small_boxes_and_boxes_at_the_edge_have_a_depth(box, pixel):
    depth = np.zeros((87, 58))
    depth[pixel] = 2.0
    assert robust_depth(depth, box, share=1.0) == 2.0


def test_a_box_outside_of_the_image_has_none():
    assert robust_depth(scene(), (90.0, 99.0, 0.0, 5.0)) == 0.0


@pytest.mark.parametrize("mount", MOUNTS)
def test_locate(mount):
    """A rectangle painted where a square plate projects to."""
    camera = intrinsics(mount)
    plate = np.array([0.1, -0.15, 1.2])
    pixel = camera.project(plate)
    half = np.array(camera.focal) * 0.06 / 1.2
    low, high = pixel + 0.5 - half, pixel + 0.5 + half
    depth = np.full(camera.shape, 2.5)
    depth[int(low[0]) : int(high[0]) + 1, int(low[1]) : int(high[1]) + 1] = 1.2
    pose = camera_pose({**robot.STOWED, "head_pan": -0.4})
    detection = Detection("can", 0.9, (low[0], high[0], low[1], high[1]))
    point = locate(detection, depth, camera, pose)
    assert point is not None
    np.testing.assert_allclose(point, pose.mat @ plate + pose.pos, atol=1e-9)
    assert locate(detection, np.zeros(camera.shape), camera, pose) is None


def test_a_camera_that_looks_ahead_sees_the_floor_below_the_horizon():
    """Signs: what is low and right in the image is low and right of the robot, whose y points left."""
    camera = intrinsics()
    pose = camera_pose({**robot.STOWED, "head_tilt": 0.0})
    box = (70.0, 74.0, 50.0, 54.0)
    point = locate(Detection("can", 1.0, box), np.full(camera.shape, 1.0), camera, pose)
    assert point is not None
    assert point[0] > 0.8 and point[1] < pose.pos[1] - 0.2 and point[2] < pose.pos[2] - 0.4


def test_best_of():
    found = [Detection(*some, BOX) for some in (("can", 0.4), ("mug", 0.9), ("can", 0.6))]
    assert best_of(found, "can") is found[2]
    assert best_of(found, "banana") is None


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda: robust_depth(np.zeros(5), BOX), "two dimensions"),
        (lambda: robust_depth(scene(), (5, 5, 0, 4)), "top < bottom"),
        (lambda: robust_depth(scene(), BOX, share=0.0), "share"),
        (lambda: Intrinsics((0, 5), (1.0, 1.0), (0.0, 0.0)), "positive"),
        (lambda: Intrinsics((5, 5), (1.0, float("nan")), (0.0, 0.0)), "positive"),
        (lambda: Intrinsics.from_calibration(5, 5, (1.0, 1.0), (2.0, 2.0), "upside"), "'upside'"),
        (lambda: locate(Detection("can", 1.0, BOX), np.ones((58, 87)), intrinsics(), AHEAD), r"\(87, 58\)"),
    ],
)
def test_rejects(call, message):
    with pytest.raises(ValueError, match=message):
        call()
