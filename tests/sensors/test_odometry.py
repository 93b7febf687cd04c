"""Errors of the odometry: none without alphas, and as large as AMCL's model has them."""

import numpy as np
import pytest
import warp as wp

from spin_rl.sensors.odometry import UPDATE_M, UPDATE_RAD, Odometry, OdometryConfig

NUM_WORLDS = 4000


def drive(device, cfg, poses):
    """Pose that is told at the end of a way of poses, shape (NUM_WORLDS, 3)."""
    with wp.ScopedDevice(device):
        qpos = wp.zeros((NUM_WORLDS, 3), dtype=float)
        seed, episode = wp.array([5], dtype=wp.int32), wp.zeros(NUM_WORLDS, dtype=wp.int32)
        everywhere = wp.full(NUM_WORLDS, True, dtype=bool)
    odometry = Odometry(qpos, cfg, seed=seed, episode=episode)
    for i, pose in enumerate(poses):
        qpos.assign(np.tile(np.float32(pose), (NUM_WORLDS, 1)))
        if i == 0:
            odometry.begin(everywhere)
        odometry.update()
    return odometry.pose.numpy()


def test_without_errors_it_is_the_pose_in_the_frame_of_the_start(device):
    t = np.linspace(0.0, 1.0, 200)
    poses = np.stack((2.0 * np.cos(3.0 * t), 2.0 * np.sin(3.0 * t), 0.5 * np.pi + 3.0 * t), axis=1)
    told = drive(device, OdometryConfig(0.0, 0.0, 0.0, 0.0), poses)[0]
    # From (2, 0), facing +y, along a circle about the origin: it ends 3 rad further.
    dx, dy = 2.0 * np.cos(3.0) - 2.0, 2.0 * np.sin(3.0)
    np.testing.assert_allclose(told, (dy, -dx, 3.0), atol=1e-3)


@pytest.mark.parametrize("steps", [50, 400])
def test_errors_of_a_way_do_not_depend_on_its_steps(device, steps):
    way = 5.0
    poses = np.zeros((steps + 1, 3))
    poses[:, 0] = np.linspace(0.0, way, steps + 1)
    x, y, yaw = drive(device, OdometryConfig(), poses).T
    one_update = 0.2 * UPDATE_M**2
    expected = one_update * np.sqrt(way / UPDATE_M)
    assert x.std() == pytest.approx(expected, rel=0.05)
    assert yaw.std() == pytest.approx(expected, rel=0.05)
    # A heading that walks at random integrates to way / sqrt(3) times its last deviation.
    assert y.std() == pytest.approx(expected * way / np.sqrt(3.0), rel=0.05)
    assert x.mean() == pytest.approx(way, abs=0.01)


def test_errors_of_a_turn(device):
    poses = np.zeros((101, 3))
    poses[:, 2] = np.linspace(0.0, 2.0 * np.pi, 101)
    yaw = drive(device, OdometryConfig(), poses)[:, 2]
    assert yaw.std() == pytest.approx(0.2 * UPDATE_RAD**2 * np.sqrt(2.0 * np.pi / UPDATE_RAD), rel=0.05)
    assert yaw.mean() == pytest.approx(2.0 * np.pi, abs=0.02)
