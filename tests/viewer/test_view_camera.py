import mujoco
import numpy as np
import pytest
from viewer_worlds import POOL, snapshot

from spin_rl.viewer.camera import DRIVE_VIEW, GRASP_VIEW, TABLE_VIEW, FollowCamera, PinholeCamera
from spin_rl.viewer.stage import Stage

WIDTH, HEIGHT = 320, 200


@pytest.fixture(scope="module")
def stage() -> Stage:
    return Stage(POOL, "portrait")


def opengl_pixels(model, data, camera_id, points):
    """Pixels by the eye, axes and frustum of MuJoCo's abstract renderer."""
    camera = mujoco.MjvCamera()
    camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, camera_id
    scene = mujoco.MjvScene(model, maxgeom=200)
    mujoco.mjv_updateScene(
        model, data, mujoco.MjvOption(), mujoco.MjvPerturb(), camera, mujoco.mjtCatBit.mjCAT_ALL.value, scene
    )
    eyes = scene.camera
    pos = 0.5 * (eyes[0].pos + eyes[1].pos)
    forward, up = eyes[0].forward, eyes[0].up
    right = np.cross(forward, up)
    offset = points - pos
    depth = offset @ forward
    near, top, bottom = eyes[0].frustum_near, eyes[0].frustum_top, eyes[0].frustum_bottom
    half_width = 0.5 * (top - bottom) * WIDTH / HEIGHT
    column = 0.5 * WIDTH * (1 + (offset @ right) * near / depth / half_width)
    row = HEIGHT * (top - (offset @ up) * near / depth) / (top - bottom)
    return np.stack((column, row), -1)


@pytest.mark.parametrize("name", ["view", "follow", "depth_camera"])
def test_projection_is_that_of_mujocos_cameras(stage, name):
    stage.pose(snapshot(base=(0.3, -0.1, 0.7), head_pan=0.4, head_tilt=-0.5))
    camera = stage.model.camera(name).id
    data, model = stage.data, stage.model
    pinhole = PinholeCamera(
        data.cam_xpos[camera],
        data.cam_xmat[camera].reshape(3, 3),
        float(model.cam_fovy[camera]),
        WIDTH,
        HEIGHT,
    )
    rng = np.random.default_rng(0)
    local = np.concatenate((rng.uniform(-1, 1, (50, 2)), -rng.uniform(0.5, 4, (50, 1))), -1)
    points = pinhole.pos + local @ pinhole.mat.T
    pixels, depth = pinhole.project(points)
    np.testing.assert_allclose(pixels, opengl_pixels(model, data, camera, points), atol=0.02)
    np.testing.assert_allclose(depth, -local[:, 2], atol=1e-9)


def test_points_behind_the_camera_have_no_pixel():
    camera = PinholeCamera(np.zeros(3), np.eye(3), 45.0, WIDTH, HEIGHT)
    pixels, depth = camera.project(np.array([(0.0, 0.0, 1.0), (0.0, 0.0, -1.0)]))
    assert np.isnan(pixels[0]).all() and depth[0] == -1.0
    np.testing.assert_allclose(pixels[1], (WIDTH / 2, HEIGHT / 2))


def test_segments_are_cut_at_the_camera():
    camera = PinholeCamera(np.zeros(3), np.eye(3), 45.0, WIDTH, HEIGHT)
    behind, front = np.array([0.1, 0.0, 1.0]), np.array([0.1, 0.0, -1.0])
    for start, end in ((behind, front), (front, behind)):
        segment = camera.project_segment(start, end)
        assert np.isfinite(segment).all()
        kept = 1 if start is behind else 0
        np.testing.assert_allclose(segment[kept], camera.project(front[None])[0][0])
        assert segment[1 - kept][0] > segment[kept][0]  # nearer, so farther from the middle
    assert camera.project_segment(behind, behind + 1.0) is None


def test_placed_view_looks_at_its_target_upright(stage):
    stage.pose(snapshot())
    pos, target = np.array([-2.0, 1.0, 2.0]), np.array([0.5, 0.2, 0.4])
    stage.place_view(pos, target)
    mat = stage.data.camera("follow").xmat.reshape(3, 3)
    np.testing.assert_allclose(mat.T @ mat, np.eye(3), atol=1e-12)
    assert np.linalg.det(mat) == pytest.approx(1.0)
    pinhole = PinholeCamera(pos, mat, 45.0, WIDTH, HEIGHT)
    pixels, _ = pinhole.project(np.stack((target, target + (0, 0, 0.1))))
    np.testing.assert_allclose(pixels[0], (WIDTH / 2, HEIGHT / 2), atol=1e-9)
    assert pixels[1, 1] < pixels[0, 1] and pixels[1, 0] == pytest.approx(WIDTH / 2)


def test_follow_camera_turns_smoothly():
    follow, view = FollowCamera(time_constant=1.0), ((-2.0, 0.0, 1.5), (0.3, 0.0, 0.4))
    pos, target = follow.place(np.array([1.0, 2.0, 0.0]), view, 0.1)
    np.testing.assert_allclose(pos, (-1.0, 2.0, 1.5))
    assert target[0] > 1.0
    turned = np.array([1.0, 2.0, np.pi / 2])
    assert follow.place(turned, view, 0.1)[0][0] < -0.9  # hardly moved
    for _ in range(200):
        pos, target = follow.place(turned, view, 0.1)
    np.testing.assert_allclose(pos, (1.0, 0.0, 1.5), atol=1e-6)
    np.testing.assert_allclose(target, (1.0, 2.3, 0.4), atol=1e-6)


def test_views_of_a_table_look_to_the_side_of_the_arm_the_closer_one_farther():
    base = np.array([1.0, 2.0, np.pi / 2])  # right is +x
    (_, table), (pos, grasp) = (FollowCamera().place(base, view, 0.1) for view in (TABLE_VIEW, GRASP_VIEW))
    assert 1.0 < table[0] < grasp[0] and grasp[0] > 1.4
    assert pos[0] > 1.0 and pos[1] < 1.5


def test_the_camera_goes_from_one_view_to_another_without_a_jump():
    follow, base = FollowCamera(), np.zeros(3)
    places = [follow.place(base, DRIVE_VIEW, 0.1)] + [follow.place(base, TABLE_VIEW, 0.1) for _ in range(60)]
    np.testing.assert_allclose(places[0], DRIVE_VIEW)
    np.testing.assert_allclose(places[-1], TABLE_VIEW, atol=0.01)
    steps = np.linalg.norm(np.diff(places, axis=0), axis=-1)
    assert 0.0 < steps.max() < 0.25
