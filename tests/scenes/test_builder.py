"""Scene geoms, checked against models that MuJoCo itself compiles."""

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp
from scene_worlds import generate

from spin_rl import robot
from spin_rl.scenes.builder import PARKED_Z_M, add_pool, geoms_of, native_model, write_geoms
from spin_rl.scenes.builder import Geoms as GeomArrays
from spin_rl.scenes.layout import PoolSpec


@pytest.fixture
def pooled_model() -> mujoco.MjModel:
    spec = robot.load_spec()
    add_pool(spec, PoolSpec())
    return spec.compile()


class Geoms:
    """The arrays of Data and Model that write_geoms fills."""

    def __init__(self, model, nworld, device):
        n = model.ngeom
        self.ids = wp.array(
            [model.geom(name).id for name in PoolSpec().geom_names()], dtype=wp.int32, device=device
        )
        self.xpos = wp.zeros((nworld, n), dtype=wp.vec3, device=device)
        self.xmat = wp.zeros((nworld, n), dtype=wp.mat33, device=device)
        self.size = wp.zeros((nworld, n), dtype=wp.vec3, device=device)
        self.rbound = wp.zeros((nworld, n), dtype=float, device=device)
        self.aabb = wp.zeros((nworld, n, 2), dtype=wp.vec3, device=device)
        self.geoms = GeomArrays()
        for name in ("xpos", "xmat", "size", "rbound", "aabb"):
            setattr(self.geoms, name, getattr(self, name))

    def write(self, layout, mask):
        mask = wp.array(mask, dtype=bool, device=layout.device)
        write_geoms(layout, self.ids, self.geoms, mask)


def test_pool_geoms_have_the_contracts_names_and_bits(pooled_model):
    for name in PoolSpec().geom_names():
        geom = pooled_model.geom(name)
        assert (geom.contype[0], geom.conaffinity[0], geom.group[0]) == (1, 0, 1)
        assert geom.bodyid[0] == 0 and geom.pos[2] == PARKED_Z_M
        kind = mujoco.mjtGeom.mjGEOM_CYLINDER if name.startswith("cylinder") else mujoco.mjtGeom.mjGEOM_BOX
        assert geom.type[0] == kind
    floor = pooled_model.geom("floor")
    assert (floor.contype[0], floor.conaffinity[0]) == (2, 0)


def test_written_geoms_equal_the_native_models(pooled_model, device):
    nworld = 12
    layout = generate(nworld, device, difficulty=2, seed=4)
    geoms = Geoms(pooled_model, nworld, device)
    geoms.write(layout, [True] * nworld)
    cylinders = 0
    for world in range(nworld):
        native = native_model(layout, world)
        data = mujoco.MjData(native)
        mujoco.mj_kinematics(native, data)
        active = layout.active.numpy()[world]
        for slot, name in enumerate(PoolSpec().geom_names()):
            ours = pooled_model.geom(name).id
            if not active[slot]:
                assert geoms.xpos.numpy()[world, ours, 2] == PARKED_Z_M
                continue
            theirs = native.geom(name).id
            cylinders += name.startswith("cylinder")
            for array, expected in (
                (geoms.xpos, data.geom_xpos[theirs]),
                (geoms.xmat, data.geom_xmat[theirs].reshape(3, 3)),
                (geoms.size, native.geom_size[theirs]),
                (geoms.rbound, native.geom_rbound[theirs]),
                (geoms.aabb, native.geom_aabb[theirs].reshape(2, 3)),
            ):
                np.testing.assert_allclose(array.numpy()[world, ours], expected, atol=2e-6, err_msg=name)
    assert cylinders > 0


def test_other_worlds_and_geoms_are_left_alone(pooled_model, device):
    layout = generate(3, device, difficulty=2)
    geoms = Geoms(pooled_model, 3, device)
    geoms.write(layout, [False, True, False])
    for array in (geoms.xpos, geoms.xmat, geoms.size, geoms.rbound, geoms.aabb):
        values = array.numpy()
        assert not values[[0, 2]].any()
        assert not np.delete(values[1], geoms.ids.numpy(), axis=0).any()
        assert values[1].any()


def test_a_native_robot_touches_the_wall_it_stands_in(device):
    model = native_model(generate(1, device, scenario=1))
    data = mujoco.MjData(model)
    data.qpos[:] = robot.qpos_from_joints(model, dict(robot.STOWED))
    data.qpos[1] = 0.4
    mujoco.mj_forward(model, data)
    names = {tuple(sorted(model.geom(int(g)).name for g in contact.geom)) for contact in data.contact}
    assert ("base", "wall_0") in names


def test_arrays_that_worlds_share_are_rejected(pooled_model, device):
    with wp.ScopedDevice(device):
        model = mjw.put_model(pooled_model, batch_sizes={"geom_size": 2, "geom_aabb": 2})
        data = mjw.make_data(pooled_model, nworld=2)
    with pytest.raises(ValueError, match="geom_rbound"):
        geoms_of(model, data)
