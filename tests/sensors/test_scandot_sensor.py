"""The scandot sensor on live mujoco_warp data."""

from types import SimpleNamespace

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

from spin_rl.sensors.scandots import Scandots

# The optical frame (x right, y down, z forward) of a level camera that looks along the base's +x, 1 m up.
XML = """
<mujoco>
  <worldbody>
    <body name="base">
      <joint type="slide" axis="1 0 0"/>
      <joint type="slide" axis="0 1 0"/>
      <joint type="hinge" axis="0 0 1"/>
      <geom type="sphere" size=".1" contype="0" conaffinity="0"/>
      <site name="other" pos="9 9 9"/>
      <site name="camera" pos="0 0 1" xyaxes="0 -1 0  0 0 -1"/>
    </body>
  </worldbody>
</mujoco>
"""
POSES = [[0.0, 0.0, 0.0], [0.0, 0.0, np.pi / 2], [1.0, 0.0, np.pi]]


def obstacles(num_worlds, device):
    """In every world: a small box at (1.5, 0, 1), and an unused slot at the same place."""
    shape = (num_worlds, 2)
    return SimpleNamespace(
        pos=wp.array(np.full((*shape, 3), [1.5, 0.0, 1.0]), dtype=wp.vec3, device=device),
        yaw=wp.zeros(shape, dtype=float, device=device),
        half_size=wp.array(np.full((*shape, 3), 0.1), dtype=wp.vec3, device=device),
        active=wp.array(np.tile([True, False], (num_worlds, 1)), dtype=wp.bool, device=device),
        is_cylinder=wp.zeros(2, dtype=wp.bool, device=device),
        is_wall=wp.zeros(2, dtype=wp.bool, device=device),
        nearby=wp.array(np.tile([0, 1], (num_worlds, 1)), dtype=wp.int32, device=device),
    )


@pytest.fixture
def world(device):
    m = mujoco.MjModel.from_xml_string(XML)
    with wp.ScopedDevice(device):
        model = mjw.put_model(m)
        data = mjw.put_data(m, mujoco.MjData(m), nworld=len(POSES))
    return m, model, data


def make_sensor(world, device, **options):
    m, _, data = world
    options = {"camera_site": m.site("camera").id, "tan_half_fov": (0.5, 0.5), **options}
    scene = options.pop("obstacles", None) or obstacles(len(POSES), device)
    return Scandots(scene, data.qpos, data.site_xpos, data.site_xmat, **options)


def place(world, device):
    _, model, data = world
    data.qpos.assign(np.array(POSES, dtype=np.float32))
    with wp.ScopedDevice(device):
        mjw.kinematics(model, data)


def flags(tokens):
    return tokens.numpy()[..., 24:].sum(-1)


@pytest.mark.parametrize("occlusion, in_view", [(False, 8), (True, 4)])
def test_reads_base_and_camera_of_each_world(world, device, occlusion, in_view):
    sensor = make_sensor(world, device, occlusion=occlusion)
    place(world, device)
    sensor.update()
    np.testing.assert_array_equal(flags(sensor.all), [[8, 0]] * 3)
    np.testing.assert_array_equal(flags(sensor.visible), [[in_view, 0], [0, 0], [0, 0]])
    nearest = sensor.all.numpy()[:, 0, :3]
    # The second and third robots face away: the box is to the right of one, and behind the other.
    np.testing.assert_allclose(
        np.abs(nearest), [[1.4, 0.1, 0.9], [0.1, 1.4, 0.9], [0.4, 0.1, 0.9]], atol=1e-5
    )
    np.testing.assert_array_equal(np.sign(nearest[[0, 1, 2], [0, 1, 0]]), [1, -1, -1])


@pytest.mark.parametrize("options, seen", [({"window": 1.45}, 4), ({"near": 1.5}, 4), ({"near": 2.0}, 0)])
def test_options(world, device, options, seen):
    sensor = make_sensor(world, device, occlusion=False, **options)
    place(world, device)
    sensor.update()
    assert flags(sensor.visible)[0, 0] == seen


def test_graph_replay_follows_the_robot(world, device):
    sensor = make_sensor(world, device)
    place(world, device)
    sensor.update()
    eager = sensor.visible.numpy().copy()
    _, model, data = world
    with wp.ScopedDevice(device), wp.ScopedCapture() as capture:
        mjw.kinematics(model, data)
        sensor.update()
    data.qpos.assign(np.array(POSES[::-1], dtype=np.float32))
    wp.capture_launch(capture.graph)
    np.testing.assert_allclose(sensor.visible.numpy(), eager[::-1], atol=1e-6)
    assert flags(sensor.visible)[2, 0] == 4


@pytest.mark.parametrize(
    "options, message",
    [
        ({"window": 0.0}, "window"),
        ({"near": -0.1}, "near"),
        ({"tan_half_fov": (0.5, 0.0)}, "tan_half_fov"),
        ({"camera_site": 2}, "camera_site"),
        ({"camera_site": -1}, "camera_site"),
        ({"obstacles": obstacles(2, "cpu")}, "2 worlds"),
    ],
)
def test_rejects(world, device, options, message):
    with pytest.raises(ValueError, match=message):
        make_sensor(world, device, **options)
