import mujoco
import numpy as np
import pytest

from spin_rl import robot
from spin_rl.sensors.depth.camera import DepthCamera
from spin_rl.speed import depth as depth_speed
from spin_rl.speed.peers.depth import NativeRays, check_agreement
from spin_rl.speed.timing import Stopwatch

TAN = robot.camera_tan_half_fov("portrait")


@pytest.fixture(scope="module")
def primitives(device):
    return depth_speed.primitive_worlds(2, device, seed=3)


def camera_of(worlds) -> DepthCamera:
    site = worlds.mj_model.site(worlds.site).id
    camera = DepthCamera(worlds.mj_model, worlds.model, worlds.data, camera_site=site, tan_half_fov=TAN)
    camera.update()
    return camera


def test_worlds_differ_and_show_something(primitives):
    images = camera_of(primitives).depth.numpy()
    assert (images > 0.0).mean() > 0.5 and (images[0] != images[1]).mean() > 0.3
    assert primitives.mj_model.ngeom == depth_speed.NUM_PRIMITIVES


def test_rows_of_both_scenes(device, make_nav_env):
    rows = depth_speed.measure_depth(
        lambda count: make_nav_env(num_envs=count), [2], device, 0.2, 1, Stopwatch()
    )
    assert [row.name.split(",")[1].strip() for row in rows] == ["30 primitives"] * 5 + ["corridor"] * 5
    peers = [row.baseline for row in rows if row.baseline]
    assert len(peers) == 6 and {peer.split(",")[0] for peer in peers} == {
        "C MuJoCo mj_multiRay",
        "mujoco_warp.render",
    }
    assert all(row.value > 0.0 and (row.ratio is None or row.ratio > 0.0) for row in rows)


def test_corridor_cameras_look_down(make_nav_env):
    worlds = depth_speed.corridor_worlds(make_nav_env(num_envs=2))
    for m, d in worlds.native:
        forward = d.site(worlds.site).xmat.reshape(3, 3)[:, 2]
        assert np.arcsin(forward[2]) == pytest.approx(depth_speed.TILT, abs=1e-5)
        assert m.site(worlds.site).bodyid[0] == m.body("head_tilt").id


def test_peers_that_draw_something_else_are_refused(primitives):
    camera = camera_of(primitives)
    images = NativeRays(primitives.native, primitives.site, TAN, camera.depth.shape[1:], 10.0).images()
    check_agreement(camera, images, 10.0, "rays")
    with pytest.raises(RuntimeError, match=r"rays differ in 100"):
        check_agreement(camera, images + 0.1, 20.0, "rays")


def test_operations_count_the_rectangles_drawn(device):
    """A floor alone fills the image: two operations and a comparison a pixel."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    spec.worldbody.add_site(name="eye", pos=[0, 0, 1], quat=[0, 1, 0, 0])
    m = spec.compile()
    d = mujoco.MjData(m)
    mujoco.mj_kinematics(m, d)
    worlds = depth_speed.batch([(m, d)], device)
    camera = DepthCamera(m, *worlds, camera_site=0, tan_half_fov=TAN, shape=(20, 30))
    camera.update()
    assert depth_speed.operations(camera) == (600.0, 1800.0)
