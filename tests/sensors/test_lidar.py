"""The lidar against rays of C MuJoCo, and what its data sheet says."""

import mujoco
import numpy as np
import pytest
import torch
import warp as wp

from spin_rl import robot
from spin_rl.scenes.builder import native_model
from spin_rl.scenes.layout import PoolSpec
from spin_rl.sensors.lidar import LASER_SITE, Lidar, LidarConfig
from spin_rl.sim.config import SimConfig
from spin_rl.sim.simulation import Simulation
from spin_rl.tasks.nav.config import NavConfig

NUM_WORLDS = 12


def make_lidar(sim, episode=0, **options):
    with wp.ScopedDevice(sim.device):
        seed = wp.array([3], dtype=wp.int32)
        number = wp.full(sim.nworld, episode, dtype=wp.int32)
    return Lidar(sim, LidarConfig(enabled=True, **options), seed=seed, episode=number)


@pytest.fixture(scope="module")
def sim(device):
    """Robots among slots of random shape and height, some around the lidar itself; one world has none."""
    rng = np.random.default_rng(1)
    sim = Simulation(NUM_WORLDS, PoolSpec(), robot.SPEED_PROFILES["paper"], SimConfig(), device)
    layout, shape = sim.layout, (NUM_WORLDS, sim.layout.pool.num_slots)
    half = rng.uniform(0.03, 0.4, (*shape, 3))
    half[:, : layout.pool.first_box, 0] *= 8.0
    half[:, layout.pool.first_cylinder :, 1] = half[:, layout.pool.first_cylinder :, 0]
    layout.half_size.assign(half.astype(np.float32))
    layout.pos.assign(rng.uniform([-4.0, -4.0, 0.0], [4.0, 4.0, 0.6], (*shape, 3)).astype(np.float32))
    layout.yaw.assign(rng.uniform(-4.0, 4.0, shape).astype(np.float32))
    layout.active.assign((rng.random(shape) < 0.7) & (np.arange(NUM_WORLDS) < NUM_WORLDS - 1)[:, None])
    base = rng.uniform([-2.0, -2.0, -4.0], [2.0, 2.0, 4.0], (NUM_WORLDS, 3))
    sim.data.qpos.assign(np.pad(base, ((0, 0), (0, sim.mj_model.nq - 3))).astype(np.float32))
    return sim


def native(sim, lidar, world):
    """Ranges of one world by mj_ray, -1 where nothing is hit; the robot is left out."""
    model = native_model(sim.layout, world)
    data = mujoco.MjData(model)
    base = sim.data.qpos.numpy()[world, :3]
    data.qpos[:3] = base
    mujoco.mj_forward(model, data)
    groups, geom = np.array([0, 1, 0, 0, 0, 0], dtype=np.uint8), np.zeros(1, dtype=np.int32)
    ranges = []
    for angle in base[2] + lidar.angles:
        ray = np.array([np.cos(angle), np.sin(angle), 0.0])
        ranges.append(mujoco.mj_ray(model, data, data.site(LASER_SITE).xpos, ray, groups, 1, -1, geom))
    return np.array(ranges)


def lidar_exact(lidar):
    lidar.update()
    return lidar.ranges.numpy()


def test_ranges_are_those_of_mujoco(sim):
    lidar = make_lidar(sim, near_m=0.0, far_m=50.0, rate_hz=100.0, noise=0.0)
    ranges = lidar_exact(lidar)
    shown = ~lidar.hidden
    compared = 0
    for world in range(NUM_WORLDS):
        theirs = native(sim, lidar, world)
        mine = np.where(ranges[world] == 0.0, -1.0, ranges[world])
        if (theirs >= 0.0).any() and (mine[shown] < 0.0).all():
            continue  # inside of a slot
        agree = np.isclose(mine, theirs, atol=2e-4) | ~shown
        # A ray along an edge may go either way by rounding.
        assert agree.mean() > 0.995, world
        compared += 1
    assert compared >= NUM_WORLDS - 2
    assert (ranges[-1] == 0.0).all()


def test_a_turn_takes_two_steps_and_comes_piece_by_piece(sim):
    lidar = make_lidar(sim, noise=0.0)
    everything = make_lidar(sim, rate_hz=100.0, noise=0.0)
    everything.update()
    packets = []
    for _ in range(20):
        lidar.update()
        packets.append(lidar.ranges.numpy().copy())
    swept = np.array(packets) >= 0.0
    assert (swept.sum(axis=2) == 198).all()  # 360 rays, 5.5 turns a second, 10 steps a second
    assert (swept.sum(axis=0) == 11).all()  # 2 seconds are 11 turns
    whole = np.where(swept[0], packets[0], packets[1])
    np.testing.assert_array_equal(whole[swept[0] | swept[1]], everything.ranges.numpy()[swept[0] | swept[1]])


def test_the_mast_hides_what_is_behind_it(sim):
    lidar = make_lidar(sim)
    hidden = np.rad2deg(lidar.angles[lidar.hidden])
    # By the MJCF the mast stands 0.07 m behind and 0.135 m to the left of the lidar.
    # 0.024 m thick: 9 degrees to either side of 117.7.
    assert (hidden.min(), hidden.max(), len(hidden)) == pytest.approx((109.0, 126.0, 18))
    lidar.update()
    assert (lidar.ranges.numpy()[:, lidar.hidden] <= 0.0).all()


def test_noise_is_a_share_of_the_range_and_near_and_far_are_cut(sim):
    exact = make_lidar(sim, near_m=0.0, far_m=50.0, rate_hz=100.0, noise=0.0)
    exact.update()
    noisy = make_lidar(sim, rate_hz=100.0, near_m=0.3, far_m=3.0, noise=0.01)
    errors = []
    for _ in range(20):
        noisy.update()
        measured, true = noisy.ranges.numpy(), exact.ranges.numpy()
        back = measured > 0.0
        assert (measured[back] >= 0.3).all() and not back[true > 3.0].any()
        errors.append((measured / np.maximum(true, 1e-9) - 1.0)[back & (true > 0.5)])
    errors = np.concatenate(errors)
    assert abs(errors.mean()) < 3e-4 and 0.0097 < errors.std() < 0.0103


def test_a_survey_sees_all_but_what_moves(device, make_nav_env):
    env = make_nav_env(NavConfig(lidar=LidarConfig(enabled=True, noise=0.0)), 2)
    layout = env.sim.layout
    scene = layout.scene(0)
    scene.active[:] = False
    for slot, x, speed in ((layout.pool.first_box, 3.0, 0.0), (layout.pool.first_box + 1, 1.5, 0.5)):
        scene.active[slot] = True
        scene.pos[slot], scene.half_size[slot] = (x, 0.0, 0.5), (0.1, 0.5, 0.5)
        scene.yaw[slot], scene.motion_speed[slot] = 0.0, speed
        scene.home[slot], scene.retreat[slot] = scene.pos[slot], (0.0, 1.0)
    scene.start[:] = (0.0, 0.0, 0.5 * np.pi)
    layout.load(scene)
    survey = env.lidar.survey()
    # Ray 270 looks along +x from a base that faces +y; half a turn further it is ray 90.
    here = survey.scan(np.zeros((2, 3)), np.array([True, True]))
    # A metre to the right is 1 m along +x.
    there = survey.scan(np.array([[0.0, -1.0, np.pi]] * 2), np.array([True, False]))
    assert here[:, 270] == pytest.approx(2.9, abs=0.01)
    assert there[0, 90] == pytest.approx(1.9, abs=0.01) and not there[1].any()


def test_groups_are_there_where_they_are_enabled(make_nav_env):
    env = make_nav_env(NavConfig(lidar=LidarConfig(enabled=True)), 4)
    obs, *_ = env.step(torch.zeros(4, 10))
    assert obs["lidar"].shape == (4, 360) and obs["odometry"].shape == (4, 3)
    assert ((obs["lidar"] >= 0.0).sum(dim=1) == 198).all()
    assert (obs["odometry"].abs() < 0.01).all()
