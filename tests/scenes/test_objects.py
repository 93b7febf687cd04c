"""Objects written into the batched model, against models of one object that MuJoCo's compiler made."""

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

from spin_rl import robot
from spin_rl.scenes.builder import native_model
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.scenes.objects.model import MODEL_FIELDS, ObjectIds, ObjectModel, write_objects
from spin_rl.scenes.objects.shapes import KINDS, OBJECT_GEOMS, OBJECTS, SceneObject, add_object

FACTORS = (0.9, 1.0, 1.15, 0.95, 1.1)


def objects():
    """One of every kind, all of other sizes, masses and frictions than the nominal ones."""
    return [
        SceneObject(
            kind,
            factor * np.array(KINDS[kind].half_extents),
            0.7 * factor * KINDS[kind].mass,
            1.3 * factor,
            np.array([0.3, -0.2, 0.5, 0.7 * factor]),
        )
        for kind, factor in zip(OBJECTS, FACTORS, strict=True)
    ]


def batched(device):
    """A compiled model with the object, its batched arrays and where the object is in them."""
    spec = robot.load_grasp_spec()
    add_object(spec)
    model = spec.compile()
    with wp.ScopedDevice(device):
        batch = mjw.put_model(model, batch_sizes=dict.fromkeys(MODEL_FIELDS, len(OBJECTS)))
    out = ObjectModel()
    for name in MODEL_FIELDS:
        setattr(out, name, getattr(batch, name))
    return model, batch, out, ObjectIds.of(model, device)


def write(ids, out, objs, mask, device):
    with wp.ScopedDevice(device):
        write_objects(
            ids,
            wp.array(mask, dtype=bool),
            kind=wp.array([OBJECTS.index(obj.kind) for obj in objs], dtype=wp.int32),
            half_extents=wp.array([obj.half_extents for obj in objs], dtype=wp.vec3),
            mass=wp.array([obj.mass for obj in objs], dtype=float),
            friction=wp.array([obj.friction for obj in objs], dtype=float),
            out=out,
        )


@pytest.fixture(scope="module")
def written(device):
    model, batch, out, ids = batched(device)
    write(ids, out, objects(), [True] * len(OBJECTS), device)
    return model, {name: getattr(batch, name).numpy() for name in MODEL_FIELDS}


def native(obj):
    empty = Scene.empty(PoolSpec())
    return native_model(empty, obj=obj)


def turn(quat):
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, np.asarray(quat, dtype=np.float64))
    return matrix.reshape(3, 3)


@pytest.mark.parametrize("world", range(len(OBJECTS)), ids=OBJECTS)
def test_written_object_is_what_mujoco_compiles(world, written):
    model, fields = written
    reference = native(objects()[world])
    used = [
        name for name in OBJECT_GEOMS if mujoco.mj_name2id(reference, mujoco.mjtObj.mjOBJ_GEOM, name) >= 0
    ]
    assert len(used) == (2 if OBJECTS[world] == "banana" else 1)
    for name in OBJECT_GEOMS:
        geom = model.geom(name).id
        if name not in used:
            assert fields["geom_rbound"][world, geom] < 1e-3
            assert np.abs(fields["geom_pos"][world, geom]).max() < 1e-3
            continue
        expected = reference.geom(name).id
        for field in ("geom_rbound", "geom_pos", "geom_size"):
            value = getattr(reference, field)[expected].copy()
            np.testing.assert_allclose(fields[field][world, geom], value, atol=1e-6, err_msg=field)
        box = reference.geom_aabb[expected].reshape(2, 3)
        np.testing.assert_allclose(fields["geom_aabb"][world, geom], box, atol=1e-6)
        # A cylinder or capsule may be turned about its axis; its aabb is the same.
        axis = turn(fields["geom_quat"][world, geom])[:, 2]
        assert abs(axis @ turn(reference.geom_quat[expected])[:, 2]) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("world", range(len(OBJECTS)), ids=OBJECTS)
def test_written_inertia_is_what_mujoco_computes_from_the_shape(world, written):
    model, fields = written
    reference = native(objects()[world])
    body, expected = model.body("object").id, reference.body("object").id
    assert fields["body_mass"][world, body] == pytest.approx(reference.body_mass[expected], rel=1e-6)
    assert fields["body_subtreemass"][world, body] == pytest.approx(reference.body_mass[expected], rel=1e-6)
    np.testing.assert_allclose(reference.body_ipos[expected], 0.0, atol=1e-9)
    axes = turn(reference.body_iquat[expected])
    inertia = axes @ np.diag(reference.body_inertia[expected]) @ axes.T
    scale = np.abs(inertia).max()
    np.testing.assert_allclose(np.diag(fields["body_inertia"][world, body]), inertia, atol=1e-6 * scale)
    weights = fields["body_invweight0"][world, body]
    np.testing.assert_allclose(weights, reference.body_invweight0[expected], rtol=1e-5)
    dofs, first = reference.joint("object").dofadr[0], model.joint("object").dofadr[0]
    np.testing.assert_allclose(
        fields["dof_invweight0"][world, first:], reference.dof_invweight0[dofs : dofs + 6], rtol=1e-5
    )


@pytest.mark.parametrize("world", range(len(OBJECTS)), ids=OBJECTS)
def test_object_fills_its_bounding_box(world):
    """Rays along the axes meet the surface where the half extents say, for the nominal object."""
    kind = OBJECTS[world]
    half = np.array(KINDS[kind].half_extents)
    model = native(SceneObject(kind, half, 1.0, 1.0, np.array([0.0, 0.0, 5.0, 0.0])))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    found = np.zeros(3)
    body = model.body("object").id
    for geom in np.flatnonzero(model.geom_bodyid == body):
        # The corners of the geom's own box, or for capsules the spheres at its ends.
        rot, size = data.geom_xmat[geom].reshape(3, 3), model.geom_size[geom]
        at = data.geom_xpos[geom] - [0.0, 0.0, 5.0]
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE:
            reach = np.abs(rot[:, 2]) * size[1] + size[0]
        else:
            reach = np.abs(rot) @ model.geom_aabb[geom, 3:]
        found = np.maximum(found, np.abs(at) + reach)
    np.testing.assert_allclose(found, half, rtol=1e-6)


def test_friction_is_that_of_the_pads_and_the_object_has_less(written):
    model, fields = written
    for world, obj in enumerate(objects()):
        for names in robot.PADS.values():
            for name in names:
                friction = fields["geom_friction"][world, model.geom(name).id]
                assert friction[0] == pytest.approx(obj.friction)
                np.testing.assert_allclose(friction[1:], model.geom(name).friction[1:], rtol=1e-6)
    assert all(model.geom(name).friction[0] < 1.0 for name in OBJECT_GEOMS)


def test_masked_worlds_only(device):
    _, batch, out, ids = batched(device)
    before = {name: getattr(batch, name).numpy().copy() for name in MODEL_FIELDS}
    mask = np.array([False, True, False, True, False])
    write(ids, out, objects(), mask, device)
    for name in MODEL_FIELDS:
        after = getattr(batch, name).numpy()
        np.testing.assert_array_equal(after[~mask], before[name][~mask], err_msg=name)
        assert (after[mask] != before[name][mask]).any(), name
