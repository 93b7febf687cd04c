"""The robot in C MuJoCo behind the runtime: signs and units, the camera, contacts, and whole drives."""

import math
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from spin_rl import robot
from spin_rl.config import ConfigError
from spin_rl.deploy.agent import Agent
from spin_rl.deploy.backends.mujoco import MujocoRobot, open_robot
from spin_rl.deploy.interface import Command
from spin_rl.deploy.loop import ARRIVED, ControlLoop
from spin_rl.deploy.network import Network
from spin_rl.export.write import export_policy
from spin_rl.runners.policy_file import read_policy
from spin_rl.scenes.scene_file import parse_scene
from spin_rl.sensors.depth.robot import upright

DATA = Path(__file__).parents[1] / "data"
FAST = np.array(robot.SPEED_PROFILES["paper"].joint_velocity_max)
START = {"position": [1.0, -2.0], "yaw": 0.5}


@pytest.fixture(scope="module")
def contract():
    return Network(DATA / "tiny_nav.onnx").contract


def make(contract, **scene):
    scene = {"start": START, "goal": [6, 0], **scene}
    return MujocoRobot(parse_scene(scene), contract)


def hold(mujoco_robot, forward=0.0, turn=0.0, **targets):
    joints = dict(zip(robot.JOINTS, mujoco_robot.state().joints, strict=True)) | targets
    return Command(forward, turn, np.array([joints[name] for name in robot.JOINTS]), FAST)


def test_drives_forward_turns_left_and_stops(contract):
    one = make(contract)
    one.command(hold(one, forward=0.4))
    one.sleep_until(2.0)
    state = one.state()
    assert one.now() == state.stamp_s == pytest.approx(2.0)
    assert state.base_velocity == pytest.approx([0.4, 0.0], abs=1e-3)
    way = state.base[:2] - START["position"]
    assert 0.65 < np.hypot(*way) < 0.8 and math.atan2(way[1], way[0]) == pytest.approx(0.5, abs=1e-3)
    one.command(hold(one, turn=1.0))
    one.sleep_until(3.5)
    assert one.state().base_velocity == pytest.approx([0.0, 1.0], abs=1e-2)
    assert 1.5 < one.state().base[2] < 2.0
    one.stop()
    one.sleep_until(5.0)
    assert np.abs(one.state().base_velocity).max() < 1e-3


def test_speeds_up_as_fast_as_the_profile(contract):
    one = make(contract)
    one.command(hold(one, forward=0.8))
    one.sleep_until(0.1)
    assert 0.12 < one.state().base_velocity[0] <= 0.2 + 1e-3


@pytest.mark.parametrize(("joint", "by"), [("lift", 0.2), ("arm_extension", 0.2), ("head_pan", -1.0)])
def test_joints_follow_their_targets_within_their_speed(contract, joint, by):
    one, index = make(contract), robot.JOINTS.index(joint)
    start = one.state().joints
    slow = replace(hold(one, **{joint: start[index] + by}), joint_speed=0.5 * FAST)
    one.command(slow)
    one.sleep_until(0.2)
    assert abs(one.state().joint_velocity[index]) <= 0.5 * FAST[index] + 1e-3
    one.sleep_until(3.0)
    wanted = start.copy()
    wanted[index] += by
    np.testing.assert_allclose(one.state().joints, wanted, atol=5e-3)
    one.command(hold(one, **{joint: start[index]}))
    one.sleep_until(3.05)
    one.stop()  # in the middle of a move
    there = one.state().joints[index]
    one.sleep_until(4.0)
    assert abs(one.state().joints[index] - there) < 0.05


def test_a_wall_stops_the_robot_and_is_noted(contract):
    wall = {"position": [0.6, 0.0], "size": [0.1, 2.0, 1.0]}
    one = make(contract, start={"position": [0.0, 0.0]}, walls=[wall])
    assert one.touched == set()
    one.command(hold(one, forward=0.5))
    one.sleep_until(4.0)
    state = one.state()
    assert state.base[0] < 0.6 and abs(state.base_velocity[0]) < 0.05
    assert any("wall_0" in pair for pair in one.touched)
    depth = -min((contact.dist for contact in one.data.contact), default=0.0)
    assert 0.0 <= depth < 0.02


@pytest.mark.parametrize("mount", ["portrait", "landscape"])
def test_the_image_is_what_mujocos_camera_renders(contract, mount):
    """Against `mj_ray` of the upright image's own pixels; the camera's own image lies on its side."""
    rows, columns = (87, 58) if mount == "portrait" else (58, 87)
    fov = robot.CAMERA_FOV_DEG[:: 1 if mount == "portrait" else -1]
    camera = replace(contract.camera, mount=mount, image=(rows, columns), fov_deg=tuple(fov))
    boxes = [
        {"position": [1.5, 0.6, 0.9], "size": [0.3, 0.3, 0.3]},
        {"position": [2.0, -0.5], "size": [0.3, 0.3, 1.5]},
    ]
    scene = {"start": {"position": [0.0, 0.0]}, "joints": {"head_pan": 0.3, "lift": 0.6}, "boxes": boxes}
    one = make(replace(contract, camera=camera), **scene)
    frame = one.depth()
    info = one.connect().camera
    assert frame.image.shape == (info.height, info.width) == (58, 87)
    image = upright(frame.image, mount)
    site = one.data.site(robot.CAMERA_SITE)
    frame_mat, body = site.xmat.reshape(3, 3), one.model.site(robot.CAMERA_SITE).bodyid[0]
    groups, geom = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8), np.zeros(1, dtype=np.int32)
    tan = [math.tan(math.radians(angle) / 2) for angle in fov]
    rng, seen = np.random.default_rng(0), 0
    for row, column in zip(rng.integers(rows, size=200), rng.integers(columns, size=200), strict=True):
        x, y = tan[0] * ((2 * row + 1) / rows - 1), -tan[1] * ((2 * column + 1) / columns - 1)
        ray = np.array([x, y, 1.0])
        unit = frame_mat @ ray / np.linalg.norm(ray)
        distance = mujoco.mj_ray(one.model, one.data, site.xpos, unit, groups, True, body, geom)
        z = distance / np.linalg.norm(ray)
        wanted = z if 0.0 < z <= 10.0 else 0.0
        assert image[row, column] == pytest.approx(wanted, abs=1e-3)
        seen += wanted > 0.0
    assert seen > 100


@pytest.mark.parametrize("mount", ["portrait", "landscape"])
def test_mujocos_renderer_and_rays_see_the_same(contract, mount):
    rows, columns = (87, 58) if mount == "portrait" else (58, 87)
    fov = robot.CAMERA_FOV_DEG[:: 1 if mount == "portrait" else -1]
    camera = replace(contract.camera, mount=mount, image=(rows, columns), fov_deg=tuple(fov))
    boxes = [{"position": [1.5, 0.6, 0.9], "size": [0.3, 0.3, 0.3]}]
    scene = parse_scene({"start": {"position": [0.0, 0.0]}, "goal": [6, 0], "boxes": boxes})
    contract = replace(contract, camera=camera)
    try:
        drawn = MujocoRobot(scene, contract, renderer="egl").depth().image
    except ConfigError:
        pytest.skip("no OpenGL here")
    cast = MujocoRobot(scene, contract).depth().image
    assert drawn.shape == cast.shape and drawn.dtype == cast.dtype
    close = np.abs(drawn - cast) < 5e-3 + 2e-3 * cast
    assert close.mean() > 0.97  # all but edges
    assert ((cast == 0.0) == (drawn == 0.0)).mean() > 0.99 and (cast > 0.0).mean() > 0.3


def test_settings_are_checked(contract):
    one = open_robot({"scene": "corridor.yaml", "pixels": 174}, contract)
    assert one.connect().camera.width == 174 and one.connect().goal == (5.0, 0.0)
    with pytest.raises(ConfigError, match=r"robot\.scene: a value is needed"):
        open_robot({}, contract)
    with pytest.raises(ConfigError, match=r"robot\.speed: unknown key"):
        open_robot({"scene": "corridor.yaml", "speed": 1}, contract)
    with pytest.raises(ConfigError, match=r"robot\.renderer: unknown"):
        open_robot({"scene": "corridor.yaml", "renderer": "crayons"}, contract)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["nav-cvo", "nav-cvo-depth"])
def test_policies_drive_through_a_corridor(name, tmp_path):
    network = Network(export_policy(read_policy(name), tmp_path / f"{name}.onnx").path)
    one = open_robot({"scene": "corridor.yaml"}, network.contract)
    connection = one.connect()
    outcome = ControlLoop(one, connection, Agent(network)).run(30.0, np.array(connection.goal))
    assert outcome.reason == ARRIVED and outcome.duration_s < 15.0 and outcome.missed == 0
    scenes = [pair for pair in one.touched if any(name.startswith(("wall", "box", "cyl")) for name in pair)]
    assert scenes == []
