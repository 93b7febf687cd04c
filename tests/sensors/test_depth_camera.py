"""The depth camera on the robot, in the batched simulation."""

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp
from depth_scenes import GOLDEN, POOL, POSES, SITE, native, native_depth, scene

from spin_rl import robot
from spin_rl.sensors.depth.camera import DepthCamera, visible_geoms
from spin_rl.sim.config import SimConfig
from spin_rl.sim.graph import StepGraph
from spin_rl.sim.simulation import Simulation

TAN = robot.camera_tan_half_fov("portrait")
SMALL = (29, 20)


def simulate(scenes, device) -> Simulation:
    sim = Simulation(len(scenes), POOL, robot.SPEED_PROFILES["paper"], SimConfig(substeps=2), device)
    for world, some in enumerate(scenes):
        sim.layout.load(some, world)
    with wp.ScopedDevice(device):
        sim.reset(wp.full(sim.nworld, True, dtype=bool))
        sim.forward()
    return sim


def camera_of(sim, **options) -> DepthCamera:
    site = sim.mj_model.site(SITE).id
    return DepthCamera(
        sim.mj_model, sim.model, sim.data, camera_site=site, **{"tan_half_fov": TAN, **options}
    )


@pytest.fixture(scope="module")
def sim(device):
    """Two worlds that differ in scene, pose and camera."""
    return simulate([scene(**POSES[0]), scene(0.1, **POSES[1])], device)


def check(image, m, d, tan=TAN, max_range=10.0, clear_share=0.9):
    """Compare an image with C MuJoCo's, but for pixels whose depth jumps within 1/1000 of their width."""
    depth, *moved = (native_depth(m, d, tan, image.shape, max_range, shift) for shift in (0.0, 1e-5, -1e-5))
    clear = np.all([(np.abs(other - depth) < 0.01) & ((other > 0) == (depth > 0)) for other in moved], axis=0)
    assert clear.mean() > clear_share
    np.testing.assert_allclose(image[clear], depth[clear], rtol=0.0, atol=1e-4)


def test_golden_images(device):
    """Images that C MuJoCo drew once."""
    camera = camera_of(simulate([scene(**pose) for pose in POSES], device))
    camera.update()
    images, golden = camera.depth.numpy(), np.load(GOLDEN)
    assert images.shape == golden.shape
    assert (np.abs(images - golden) > 1e-4).mean() < 1e-3
    # The arm is in the second picture, and only there.
    nearest = [image[image > 0.0].min() for image in images]
    assert nearest[0] > 0.9 and 0.2 < nearest[1] < 0.5


@pytest.mark.parametrize("mount", ["portrait", "landscape"])
def test_scene_and_robot_as_in_c_mujoco(device, mount):
    scenes = [scene(**POSES[0]), scene(0.1, **POSES[1]), scene(head_tilt=-1.5, head_pan=-2.5)]
    sim = simulate(scenes, device)
    tan = robot.camera_tan_half_fov(mount)
    camera = camera_of(sim, tan_half_fov=tan)
    camera.update()
    assert camera.depth.shape == ((3, 87, 58) if mount == "portrait" else (3, 58, 87))
    for image, some in zip(camera.depth.numpy(), scenes, strict=True):
        check(image, *native(some), tan)


def test_as_mujoco_warp_renders(sim):
    """Its renderer on the same arrays; its camera shares the site's pose and is given the field of view."""
    m, camera = sim.mj_model, camera_of(sim)
    rows, columns = camera.depth.shape[1:]
    picture = m.cam("depth_camera").id
    m.cam_sensorsize[picture] = columns, rows
    m.cam_intrinsic[picture] = columns / (2 * TAN[1]), rows / (2 * TAN[0]), 0.0, 0.0
    with wp.ScopedDevice(sim.device):
        context = mjw.create_render_context(
            m,
            nworld=2,
            cam_active=["depth_camera"],
            cam_res=(columns, rows),
            render_rgb=False,
            render_depth=True,
        )
        mjw.camlight(sim.model, sim.data)
        mjw.refit_bvh(sim.model, sim.data, context)
        mjw.render(sim.model, sim.data, context)
    theirs = context.depth_data.numpy().reshape(camera.depth.shape)
    camera.update()
    ours = camera.depth.numpy()
    beyond = (ours == 0.0) & (theirs > 10.0)
    assert (np.abs(ours - theirs)[~beyond] > 1e-4).mean() < 2e-3


def test_step_and_camera_in_one_graph(device):
    """Replayed steps give the images of eager ones, bit for bit, and these are C MuJoCo's."""

    def steps(capture):
        sim = simulate([scene(head_tilt=-0.6), scene(head_tilt=-0.2)], device)
        camera = camera_of(sim, shape=SMALL)

        def launch():
            sim.advance()
            sim.forward()
            camera.update()

        launch()
        graph = StepGraph(launch, device, capture=capture)
        sim.views.action[:, 0] = 1.0
        sim.views.action[:, -1] = -0.5
        images = []
        for _ in range(3):
            graph.replay()
            images.append(camera.depth.numpy().copy())
        return sim, np.array(images)

    sim, replayed = steps(True)
    np.testing.assert_array_equal(replayed, steps(False)[1])
    assert (replayed[0] != replayed[-1]).any(axis=(1, 2)).all()
    for world, qpos in enumerate(sim.data.qpos.numpy()):
        m, d = native(scene())
        d.qpos[:] = qpos
        mujoco.mj_kinematics(m, d)
        check(replayed[-1, world], m, d)


def test_masked_worlds_and_moving_obstacles(sim, device):
    camera = camera_of(sim, shape=SMALL)
    camera.update()
    before = camera.depth.numpy().copy()
    geom = sim.mj_model.geom("box_0").id
    poses = sim.data.geom_xpos.numpy().copy()
    moved = poses.copy()
    moved[:, geom] += [0.2, 0.0, 0.4]
    sim.data.geom_xpos.assign(moved)
    camera.update(wp.array([True, False], dtype=bool, device=device))
    first = camera.depth.numpy().copy()
    sim.data.geom_xpos.assign(poses)
    np.testing.assert_array_equal(first[1], before[1])
    assert (first[0] != before[0]).any()
    camera.update()
    np.testing.assert_array_equal(camera.depth.numpy(), before)


def test_mounting_errors_are_a_change_of_the_camera_frame(device):
    """Of the world that has them: its image is that of a site moved and turned as much."""
    some = scene(head_tilt=-0.6)
    sim = simulate([some, some], device)
    camera = camera_of(sim, shape=SMALL)
    camera.update()
    exact = camera.depth.numpy()[0].copy()
    shift, turn = np.array([0.02, -0.03, 0.01]), np.zeros(9)
    axis = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    quat = np.array([np.cos(0.04), *(np.sin(0.04) * axis)])
    mujoco.mju_quat2Mat(turn, quat)
    camera.mount_pos.assign(np.array([[0, 0, 0], shift], dtype=np.float32))
    camera.mount_rot.assign(np.array([np.eye(3), turn.reshape(3, 3)], dtype=np.float32))
    camera.update()
    image = camera.depth.numpy()
    np.testing.assert_array_equal(image[0], exact)
    m, d = native(some)
    site = m.site(SITE).id
    frame = d.site_xmat[site].reshape(3, 3).copy()
    d.site_xpos[site] += frame @ shift
    d.site_xmat[site] = (frame @ turn.reshape(3, 3)).ravel()
    check(image[1], m, d)
    assert np.abs(image[1] - exact).max() > 0.05


def test_robot_geoms_shown(sim):
    names = {sim.mj_model.geom(geom).name for geom in visible_geoms(sim.mj_model, sim.mj_model.site(SITE).id)}
    assert {"floor", "wall_0", "box_0", "cylinder_0", "visual_base", "visual_gripper"} <= names
    assert not names & {"visual_camera", "head", "head_1", "arm_1"}


def test_a_camera_on_the_world_body_sees_the_world():
    m = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom size='.1'/><site/><geom size='.1' group='3'/></worldbody></mujoco>"
    )
    assert visible_geoms(m, 0) == [0]


@pytest.mark.parametrize(
    "options, message",
    [
        ({"max_range": 0.0}, "max_range"),
        ({"tan_half_fov": (0.5, -0.5)}, "tan_half_fov"),
        ({"shape": (0, 58)}, "shape"),
        ({"shape": (10, 8), "by_pixel": False}, "16 columns"),
        ({"camera_site": 99}, "camera_site"),
        ({"geoms": []}, "at least one"),
        ({"geoms": [0, 999]}, "geoms"),
    ],
)
def test_rejects(sim, options, message):
    options = {"camera_site": 0, "tan_half_fov": TAN, **options}
    with pytest.raises(ValueError, match=message):
        DepthCamera(sim.mj_model, sim.model, sim.data, **options)


def test_rejects_meshes():
    spec = mujoco.MjSpec()
    spec.add_mesh(name="rock", uservert=[0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1])
    spec.worldbody.add_geom(name="rock", type=mujoco.mjtGeom.mjGEOM_MESH, meshname="rock")
    spec.worldbody.add_site()
    with pytest.raises(ValueError, match="'rock' is a mesh"):
        DepthCamera(spec.compile(), None, None, camera_site=0, tan_half_fov=TAN)
