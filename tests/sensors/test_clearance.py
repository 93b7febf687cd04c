"""Clearance and haste against C MuJoCo's distances and Jacobians, and as a reward."""

import copy

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import torch
import warp as wp

from spin_rl import robot
from spin_rl.scenes.layout import PoolSpec
from spin_rl.sensors.clearance import Clearance, robot_shapes
from spin_rl.sim.config import SimConfig
from spin_rl.sim.simulation import Simulation
from spin_rl.tasks.nav.config import NavConfig

NUM_WORLDS = 40


@pytest.fixture(scope="module")
def sim(device):
    """Robots in random poses and motion, among slots of random shape; the last world has none."""
    rng = np.random.default_rng(0)
    sim = Simulation(NUM_WORLDS, PoolSpec(), robot.SPEED_PROFILES["paper"], SimConfig(), device)
    layout, shape = sim.layout, (NUM_WORLDS, sim.layout.pool.num_slots)
    half = rng.uniform(0.03, 0.4, (*shape, 3))
    half[:, : layout.pool.first_box, 0] *= 5.0
    half[:, layout.pool.first_cylinder :, 1] = half[:, layout.pool.first_cylinder :, 0]
    layout.half_size.assign(half.astype(np.float32))
    layout.pos.assign(rng.uniform([-1.5, -1.5, 0.0], [1.5, 1.5, 1.6], (*shape, 3)).astype(np.float32))
    layout.yaw.assign(rng.uniform(-3.0, 3.0, shape).astype(np.float32))
    layout.active.assign((rng.random(shape) < 0.15) & (np.arange(NUM_WORLDS) < NUM_WORLDS - 1)[:, None])
    low, high = sim.mj_model.jnt_range[3:].T
    base = rng.uniform([-0.3, -0.3, -3.0], [0.3, 0.3, 3.0], (NUM_WORLDS, 3))
    qpos = np.concatenate([base, rng.uniform(low, high, (NUM_WORLDS, len(low)))], axis=1)
    sim.data.qpos.assign(qpos.astype(np.float32))
    sim.data.qvel.assign(rng.normal(size=qpos.shape).astype(np.float32))
    with wp.ScopedDevice(device):
        for stage in (mjw.kinematics, mjw.com_pos, mjw.com_vel):
            stage(sim.model, sim.data)
    return sim


def native(sim, world, limit) -> tuple[float, float]:
    """Clearance and haste of one world by mj_geomDistance and mj_jac."""
    model, layout = copy.copy(sim.mj_model), sim.layout
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = (array.numpy()[world] for array in (sim.data.qpos, sim.data.qvel))
    mujoco.mj_forward(model, data)
    pos, yaw, half, active = (
        a.numpy()[world] for a in (layout.pos, layout.yaw, layout.half_size, layout.active)
    )
    slots = []
    for slot in np.flatnonzero(active):
        geom = model.geom(layout.pool.geom_names()[slot]).id
        cylinder = slot >= layout.pool.first_cylinder
        model.geom_size[geom] = (half[slot, 0], half[slot, 2], 0.0) if cylinder else half[slot]
        data.geom_xpos[geom] = pos[slot]
        c, s = np.cos(yaw[slot]), np.sin(yaw[slot])
        data.geom_xmat[geom] = (c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)
        slots.append(geom)
    clearance, haste = limit, 0.0
    for geom in range(model.ngeom):
        if model.geom_bodyid[geom] == 0 or model.geom_conaffinity[geom] == 0:
            continue
        size, frame = model.geom_size[geom], data.geom_xmat[geom].reshape(3, 3)
        ends = [(0, 0, size[1]), (0, 0, -size[1])]
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
            ends = [(x * size[0], y * size[1], 0.0) for x in (-1, 1) for y in (-1, 1)]
        jacobian = np.zeros((3, model.nv))
        speed = 0.0
        for end in ends:
            point = data.geom_xpos[geom] + frame @ end
            mujoco.mj_jac(model, data, jacobian, None, point, model.geom_bodyid[geom])
            speed = max(speed, np.linalg.norm(jacobian @ data.qvel))
        for slot in slots:
            distance = max(mujoco.mj_geomDistance(model, data, geom, slot, 5.0, None), 0.0)
            clearance = min(clearance, distance)
            haste = max(haste, speed**2 * (1.0 - distance / limit))
    return clearance, haste


@pytest.mark.parametrize("limit", [0.15, 1.0])
def test_agrees_with_mujoco(sim, limit):
    sensor = Clearance(sim, limit)
    sensor.update()
    wanted = np.array([native(sim, world, limit) for world in range(NUM_WORLDS)])
    assert 3 < (wanted[:, 0] < 1e-3).sum() and 3 < ((wanted[:, 0] > 0.01) & (wanted[:, 0] < limit)).sum()
    assert wanted[-1].tolist() == [limit, 0.0]
    # The longest side of a box is 0.364 m, the search ends within a 2048th of it.
    np.testing.assert_allclose(sensor.clearance.numpy(), wanted[:, 0], atol=2e-4)
    np.testing.assert_allclose(sensor.haste.numpy(), wanted[:, 1], rtol=1e-4, atol=2e-3)


def test_a_slot_below_the_middle_of_a_box(sim):
    slot, layout = sim.layout.pool.first_box, sim.layout
    saved = [array.numpy() for array in (layout.pos, layout.half_size, layout.active)]
    base = sim.data.geom_xpos.numpy()[-1, sim.mj_model.geom("base").id]
    pos, half, active = (array.copy() for array in saved)
    pos[-1, slot], half[-1, slot], active[-1, slot] = base - (0.0, 0.0, 0.0985 + 0.02 + 0.01), 0.01, True
    try:
        for array, values in zip(
            (layout.pos, layout.half_size, layout.active), (pos, half, active), strict=True
        ):
            array.assign(values)
        sensor = Clearance(sim, 0.15)
        sensor.update()
        assert sensor.clearance.numpy()[-1] <= 0.02 + 1e-6
        assert sensor.clearance.numpy()[-1] == pytest.approx(native(sim, NUM_WORLDS - 1, 0.15)[0], abs=1e-5)
    finally:
        for array, values in zip((layout.pos, layout.half_size, layout.active), saved, strict=True):
            array.assign(values)


def test_graph_replay_equals_eager(sim, device):
    sensor = Clearance(sim, 0.3)
    sensor.update()
    eager = [array.numpy().copy() for array in (sensor.clearance, sensor.haste)]
    with wp.ScopedCapture(device=device) as capture:
        sensor.update()
    for array in (sensor.clearance, sensor.haste):
        array.fill_(-1.0)
    wp.capture_launch(capture.graph)
    for array, values in zip((sensor.clearance, sensor.haste), eager, strict=True):
        np.testing.assert_array_equal(array.numpy(), values)


@pytest.mark.parametrize(
    ("geom", "joint"),
    [
        ('type="sphere" size="0.1"', '<joint type="slide"/>'),
        ('type="box" size="0.1 0.1 0.1" euler="0.3 0 0"', '<joint type="slide"/>'),
        ('type="box" size="0.1 0.1 0.1"', '<joint type="hinge" axis="1 0 0"/>'),
    ],
)
def test_a_shape_that_cannot_be_measured_is_named(geom, joint):
    xml = f'<mujoco><worldbody><body>{joint}<geom name="hand" mass="1" {geom}/></body></worldbody></mujoco>'
    with pytest.raises(ValueError, match="'hand' is no capsule and no upright box"):
        robot_shapes(mujoco.MjModel.from_xml_string(xml), "cpu")


def test_reward_counts_speed_near_walls_only(make_nav_env):
    env = make_nav_env(NavConfig(reward={"clearance": -2.0}, clearance_m=0.4, stop_on_collision=False), 4)
    drive = env.sim.views.action.clone()
    drive[:2, 0] = 1.0
    drive[:, 1] = 0.0
    for _ in range(25):
        _, reward, done, _ = env.step(drive)
        torch.testing.assert_close(reward, -2.0 * env.last_transition.haste)
        assert not done.any()
    fast, still = env.last_transition.haste[:2], env.last_transition.haste[2:]
    assert (fast > 1e-3).any() and (still < 1e-4).all()


def test_haste_is_finite_where_velocities_are_not(sim):
    cvel = sim.data.cvel.numpy()
    broken = cvel.copy()
    broken[3] = 1e30  # its square is none in float32
    sensor = Clearance(sim, 1.0)
    sim.data.cvel.assign(broken)
    sensor.update()
    sim.data.cvel.assign(cvel)
    assert sensor.clearance.numpy()[3] < 1.0 and sensor.haste.numpy()[3] == 0.0
    assert sensor.haste.numpy()[4:6].any()


def test_nothing_is_measured_without_the_term(make_nav_env):
    env = make_nav_env(NavConfig(reward={"time": -1.0, "clearance": 0.0}), 2)
    assert env._clearance is None
    env.step(env.sim.views.action.clone())
    assert env.last_transition.haste.tolist() == [0.0, 0.0]


def test_reward_variants_change_one_scale_each():
    from spin_rl.tasks.nav.spec import NAV

    shaped = NAV.as_trained().reward
    for name, scale in (("careful", {"collision": -20.0}), ("smooth", {"action_rate": -0.01})):
        assert NAV.as_trained([f"reward={name}"]).reward == shaped | scale
    assert NAV.as_trained(["reward=clearance"]).reward == shaped | {"clearance": -0.5}
    with pytest.raises(ValueError, match=r"task\.clearance_m must be positive"):
        NavConfig(clearance_m=0.0)
