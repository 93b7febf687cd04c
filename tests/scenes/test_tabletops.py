"""Tabletops: always free of contact, within reach, and a function of seed, world and counter."""

import math
from dataclasses import asdict, replace

import mujoco
import numpy as np
import pytest
import warp as wp
from omegaconf import OmegaConf

from spin_rl import robot
from spin_rl.config import ConfigError, from_mapping
from spin_rl.paths import CONF_DIR
from spin_rl.scenes.builder import native_model
from spin_rl.scenes.layout import Layout, PoolSpec
from spin_rl.scenes.objects.model import ObjectStart
from spin_rl.scenes.objects.shapes import KINDS, OBJECTS, SceneObject
from spin_rl.scenes.tabletops.generator import generate_tabletops
from spin_rl.scenes.tabletops.params import TabletopParams

POOL = PoolSpec()
TABLE = POOL.first_box
PARAMS = TabletopParams()
NUM_WORLDS = 60
FIELDS = tuple(ObjectStart.vars)


class Tables:
    """Layouts and object starts of some worlds."""

    def __init__(self, device, nworld=NUM_WORLDS, pool=POOL):
        self.layout = Layout(nworld, pool, device)
        self.object = ObjectStart()
        with wp.ScopedDevice(device):
            for name, dtype in (
                ("kind", wp.int32), ("start_pose", wp.vec4), ("half_extents", wp.vec3),
                ("mass", float), ("friction", float), ("near", bool),
            ):  # fmt: skip
                setattr(self.object, name, wp.zeros(nworld, dtype=dtype))
            self.counter = wp.zeros(nworld, dtype=wp.int32)

    def draw(self, *, seed=0, level=1.0, near=0.0, kind=-1, mask=None, params=PARAMS):
        n = self.layout.nworld
        with wp.ScopedDevice(self.layout.device):
            # Kept, since a captured graph reads them.
            self.inputs = {
                "seed": wp.array([seed], dtype=wp.int32),
                "mask": wp.array(np.ones(n, dtype=bool) if mask is None else mask, dtype=bool),
                "level": wp.full(n, level, dtype=float),
                "near_share": wp.full(n, near, dtype=float),
                "kind_choice": wp.full(n, kind, dtype=wp.int32),
            }
        self.launch(params)
        return self

    def launch(self, params=PARAMS):
        generate_tabletops(self.layout, self.object, params, counter=self.counter, **self.inputs)

    def values(self):
        arrays = {name: getattr(self.layout, name).numpy().copy() for name in Layout._PER_WORLD}
        for name in ("pos", "yaw", "half_size"):
            arrays[name][~arrays["active"]] = 0.0  # what is left of earlier scenes
        return arrays | {name: getattr(self.object, name).numpy().copy() for name in FIELDS}

    def scene_object(self, world):
        v = {name: getattr(self.object, name).numpy()[world] for name in FIELDS}
        kind, half = OBJECTS[v["kind"]], v["half_extents"].astype(np.float64)
        return SceneObject(kind, half, float(v["mass"]), float(v["friction"]), v["start_pose"])


def at_start(tables, world):
    """Model and data of C MuJoCo at a world's start."""
    scene = tables.layout.scene(world)
    model = native_model(scene, obj=tables.scene_object(world))
    data = mujoco.MjData(model)
    joints = dict(zip(robot.JOINTS, scene.start_joints, strict=True))
    data.qpos[:] = robot.qpos_from_joints(model, joints)
    data.qpos[:3] = scene.start
    mujoco.mj_forward(model, data)
    return scene, model, data


# The arm out, and the object as near as it gets: only stepping back keeps the gripper away from it.
CROWDED = replace(
    PARAMS, start_arm_extension=(0.15, 0.15), object_distance=(0.55, 0.57), start_above=(0.0, 0.02)
)


@pytest.mark.parametrize(
    ("near", "level", "params"),
    [(0.0, 0.0, PARAMS), (0.0, 1.0, PARAMS), (1.0, 0.0, PARAMS), (0.0, 0.0, CROWDED)],
    ids=["above", "anywhere", "near", "crowded"],
)
def test_robot_starts_free_of_contact_and_the_object_on_the_table(near, level, params, device):
    tables = Tables(device).draw(near=near, level=level, seed=5, params=params)
    assert set(tables.object.kind.numpy()) == set(range(len(OBJECTS)))
    for world in range(NUM_WORLDS):
        scene, model, data = at_start(tables, world)
        body = model.body("object").id
        # As float32 has it, the object may float by some micrometres.
        gap = (
            data.qpos[15]
            - scene.pos[TABLE][2]
            - scene.half_size[TABLE][2]
            - tables.scene_object(world).half_extents[2]
        )
        assert abs(gap) < 1e-5
        data.qpos[15] -= 1e-4
        mujoco.mj_forward(model, data)
        supports = 0
        for contact in data.contact:
            names = {model.geom(geom).name for geom in contact.geom}
            assert (model.geom_bodyid[contact.geom] == body).any() and "box_0" in names, (world, names)
            supports += contact.dist < 0
        assert supports


def test_table_and_object_are_of_the_asked_kind_and_size(device):
    tables = Tables(device).draw(seed=2)
    v = tables.values()
    top = 2.0 * v["pos"][:, TABLE, 2]
    nominal = np.array([kind.half_extents for kind in KINDS.values()])[v["kind"]]
    factor = v["half_extents"] / nominal
    np.testing.assert_allclose(factor, factor[:, :1].repeat(3, 1), rtol=1e-5)
    mass = v["mass"] / np.array([kind.mass for kind in KINDS.values()])[v["kind"]]
    for value, (low, high) in (
        (top, PARAMS.table_top),
        (v["half_size"][:, TABLE, 0], PARAMS.table_half_length),
        (v["half_size"][:, TABLE, 1], PARAMS.table_half_depth),
        (factor[:, 0], PARAMS.size_factor),
        (mass, PARAMS.mass_factor),
        (v["friction"], PARAMS.friction),
        (-v["start_pose"][:, 1], PARAMS.object_distance),
        (v["start_pose"][:, 3], (-math.pi, math.pi)),
    ):
        assert low - 1e-5 <= value.min() and value.max() <= high + 1e-5
        # A uniform draw of 60 worlds covers more than two thirds of its range.
        assert np.ptp(value) > 0.67 * (high - low)
    np.testing.assert_allclose(v["half_size"][:, TABLE, 2], 0.5 * top, rtol=1e-6)
    np.testing.assert_array_equal(v["goal"], v["start_pose"][:, :2])
    # In the table's frame, the object keeps its margin from the edges.
    c, s = np.cos(v["yaw"][:, TABLE]), np.sin(v["yaw"][:, TABLE])
    d = v["start_pose"][:, :2] - v["pos"][:, TABLE, :2]
    local = np.abs(np.stack([c * d[:, 0] + s * d[:, 1], c * d[:, 1] - s * d[:, 0]], 1))
    free = v["half_size"][:, TABLE, :2] - local - PARAMS.edge_margin
    radius = np.where(
        v["kind"] == OBJECTS.index("can"), v["half_extents"][:, 0], v["half_extents"][:, :2].max(1)
    )
    assert (free > radius[:, None] - 1e-5).all()


@pytest.mark.parametrize("kind", range(len(OBJECTS)), ids=OBJECTS)
def test_kind_can_be_chosen(kind, device):
    tables = Tables(device, 5).draw(kind=kind)
    np.testing.assert_array_equal(tables.object.kind.numpy(), kind)


def test_near_starts_point_the_open_gripper_at_the_object(device):
    params = replace(PARAMS, near_distance=(0.0, 0.1), near_above=(0.0, 0.02))
    tables = Tables(device).draw(near=1.0, params=params)
    assert tables.object.near.numpy().all()
    for world in range(NUM_WORLDS):
        scene, _, data = at_start(tables, world)
        site = data.site(robot.GRASP_CENTER_SITE)
        reach = data.qpos[13:16] - site.xpos
        ahead = np.array([math.sin(scene.start[2]), -math.cos(scene.start[2])])
        aside = reach[:2] - (reach[:2] @ ahead) * ahead
        # Of the banana, lengthwise, the palm stays clear.
        assert -1e-4 <= reach[:2] @ ahead <= 0.1 + 1e-4
        assert np.linalg.norm(aside) < 0.0151
        top = scene.pos[TABLE][2] + scene.half_size[TABLE][2]
        above = site.xpos[2] - max(data.qpos[15], top + 0.027)
        assert -1e-4 <= above <= 0.02 + 1e-4
        assert site.xmat.reshape(3, 3)[2, 0] <= 1e-6


def test_near_share_and_level_mix_starts(device):
    v = Tables(device, 400).draw(near=0.3, level=0.0).values()
    assert 0.2 < v["near"].mean() < 0.4
    far = ~v["near"]
    heights = {}
    for level in (0.0, 1.0):
        u = Tables(device, 400).draw(near=0.3, level=level).values()
        heights[level] = np.abs(u["start_joints"][far, 0] - v["start_joints"][far, 0])
    # At level 1 half of the starts have their lift anywhere.
    assert heights[0.0].max() == 0.0 and 0.4 < (heights[1.0] > 1e-6).mean() < 0.6


def test_head_looks_around_the_object_and_can_be_frozen(device):
    v = Tables(device).draw(params=replace(PARAMS, look_pan=0.0, look_tilt=0.0)).values()
    tables = Tables(device).draw(params=replace(PARAMS, look_pan=0.0, look_tilt=0.0))
    for world in range(8):
        _, _, data = at_start(tables, world)
        camera = data.site("camera_depth_optical_frame")
        to_object = data.qpos[13:16] - camera.xpos
        cosine = camera.xmat.reshape(3, 3)[:, 2] @ to_object / np.linalg.norm(to_object)
        assert cosine > math.cos(0.12), world
    frozen = replace(PARAMS, start_head_pan=(-1.5, -1.5), start_head_tilt=(-0.4, -0.4))
    fixed = Tables(device).draw(params=frozen).values()
    np.testing.assert_allclose(fixed["start_joints"][:, 6:], [[-1.5, -0.4]] * NUM_WORLDS, rtol=1e-6)
    free = Tables(device).draw().values()["start_joints"][:, 6:] - v["start_joints"][:, 6:]
    assert 1.0 < np.abs(free[:, 0]).max() <= PARAMS.look_pan + 1e-5


def test_surroundings_are_out_of_reach_and_differ(device):
    v = Tables(device).draw().values()
    others = v["active"].copy()
    others[:, TABLE] = False
    assert len(np.unique(others.sum(1))) > 2
    for world, slot in np.argwhere(others):
        yaw, half = v["yaw"][world, slot], v["half_size"][world, slot]
        c, s = math.cos(yaw), math.sin(yaw)
        x, y = v["pos"][world, slot, :2]
        outside = np.maximum(np.abs([c * x + s * y, c * y - s * x]) - half[:2], 0.0)
        assert np.linalg.norm(outside) >= 1.3 - 1e-5


def test_draws_are_a_function_of_seed_world_and_counter(device):
    tables = Tables(device, 8)
    first = tables.draw(seed=7, near=0.5).values()
    second = tables.draw(seed=7, near=0.5).values()
    assert (second["start_pose"] != first["start_pose"]).any(1).all()
    mask = np.arange(8) % 2 == 0
    third = tables.draw(seed=7, near=0.5, mask=mask).values()
    for name, array in third.items():
        np.testing.assert_array_equal(array[~mask], second[name][~mask], err_msg=name)
    assert (third["start_pose"] != second["start_pose"]).any(1)[mask].all()
    tables.draw(seed=7, near=0.5)
    tables.counter.zero_()
    with wp.ScopedCapture(device) as capture:
        tables.launch()
    wp.capture_launch(capture.graph)
    again = tables.values()
    for name, array in first.items():
        np.testing.assert_array_equal(again[name], array, err_msg=name)
    other = Tables(device, 8).draw(seed=8, near=0.5).values()
    assert (other["start_pose"] != first["start_pose"]).any(1).all()


def test_configuration_file_is_the_default():
    values = OmegaConf.to_container(OmegaConf.load(CONF_DIR / "scene" / "tabletop.yaml"))
    assert set(values) == set(asdict(PARAMS))
    assert from_mapping(TabletopParams, values, "scene") == PARAMS


@pytest.mark.parametrize(
    "change",
    [
        {"table_top": [0.9, 0.4]},
        {"table_top": [0.1, 0.4]},
        {"object_distance": [0.3, 0.6]},
        {"size_factor": [0.0, 1.0]},
        {"base_x": -0.1},
        {"start_head_pan": [-9.0, 0.0]},
        {"wall_share": 1.5},
        {"look_pan": float("nan")},
        {"nonsense": 1},
    ],
    ids=str,
)
def test_bad_values_name_their_key(change):
    with pytest.raises(ConfigError, match=rf"scene\.{next(iter(change))}"):
        from_mapping(TabletopParams, change, "scene")


@pytest.mark.parametrize("pool", [PoolSpec(num_walls=3), PoolSpec(num_boxes=0)], ids=["walls", "boxes"])
def test_too_small_a_pool_is_refused(pool, device):
    with pytest.raises(ValueError, match=r"pool\.num"):
        Tables(device, 2, pool).draw()
