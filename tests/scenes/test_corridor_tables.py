"""Fetch scenes: the navigation task's corridors, each with a table in reach at its end."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from omegaconf import OmegaConf

from spin_rl.config import from_mapping
from spin_rl.paths import CONF_DIR
from spin_rl.scenes.corridor_tables.generator import generate_fetch_scenes
from spin_rl.scenes.corridor_tables.params import FetchSceneParams, FetchTableParams
from spin_rl.scenes.corridors.generator import generate_layouts
from spin_rl.scenes.corridors.params import GeneratorParams
from spin_rl.scenes.layout import Layout, PoolSpec
from spin_rl.scenes.objects.model import ObjectStart
from spin_rl.scenes.objects.shapes import OBJECTS

PARAMS = FetchSceneParams()
TABLE = PARAMS.table_slot
NUM_WORLDS = 120
START_FIELDS = (
    ("kind", wp.int32), ("start_pose", wp.vec4), ("half_extents", wp.vec3),
    ("mass", float), ("friction", float), ("near", bool),
)  # fmt: skip


class Fetches:
    """Layouts and object starts of some worlds, all cells in turn."""

    def __init__(self, device, nworld=NUM_WORLDS, pool=PARAMS.pool):
        self.layout = Layout(nworld, pool, device)
        self.object = ObjectStart()
        with wp.ScopedDevice(device):
            for name, dtype in START_FIELDS:
                setattr(self.object, name, wp.zeros(nworld, dtype=dtype))
            self.counter = wp.zeros(nworld, dtype=wp.int32)

    def draw(self, *, seed=0, mask=None, kind=-1, params=PARAMS):
        common = self.arguments(seed, mask)
        kinds = wp.full(self.layout.nworld, kind, dtype=wp.int32, device=self.layout.device)
        generate_fetch_scenes(
            self.layout, self.object, params, counter=self.counter, kind_choice=kinds, **common
        )
        return self

    def arguments(self, seed, mask=None):
        n = self.layout.nworld
        with wp.ScopedDevice(self.layout.device):
            return {
                "seed": wp.array([seed], dtype=wp.int32),
                "mask": wp.array(np.ones(n, dtype=bool) if mask is None else mask, dtype=bool),
                "scenario_choice": wp.array(1 + np.arange(n) % 2, dtype=wp.int32),
                "difficulty_choice": wp.array(np.arange(n) // 2 % 3, dtype=wp.int32),
                "level": wp.full(n, 1.0, dtype=float),
            }

    def values(self):
        arrays = {name: getattr(self.layout, name) for name in Layout._PER_WORLD}
        arrays |= {f"object_{name}": getattr(self.object, name) for name, _ in START_FIELDS}
        return {name: array.numpy().copy() for name, array in arrays.items()}


@pytest.fixture(scope="module")
def fetches(device):
    return Fetches(device).draw()


def along(values):
    """Direction of the last leg of every world, from the walls' scenario and the goal, shape (n, 2)."""
    bent = values["bend"][:, None] == 1
    turned = np.stack((np.zeros(NUM_WORLDS), np.sign(values["goal"][:, 1])), -1)
    return np.where(bent, turned, [1.0, 0.0])


def in_legs_frame(points, values):
    """Points (n, 2) from the goal, as distances along the last leg and across it."""
    offset = points - values["goal"]
    ahead = along(values)
    left = np.stack((-ahead[:, 1], ahead[:, 0]), -1)
    return (offset * ahead).sum(-1), (offset * left).sum(-1)


def test_tables_stand_across_the_corridor_beyond_the_goal(fetches):
    values = fetches.values()
    table = PARAMS.table
    half, pos = values["half_size"][:, TABLE], values["pos"][:, TABLE]
    distance, aside = in_legs_frame(pos[:, :2], values)
    assert values["active"][:, TABLE].all()
    np.testing.assert_allclose(aside, 0.0, atol=1e-5)
    edge = distance - half[:, 0]
    assert (edge >= table.edge_distance[0] - 1e-5).all() and (edge <= table.edge_distance[1] + 1e-5).all()
    assert np.ptp(edge) > 0.05
    assert (half[:, 1] < 0.5 * PARAMS.corridor.width).all()
    assert (distance + half[:, 0] <= PARAMS.corridor.beyond_goal[0] + 1e-5).all()
    np.testing.assert_allclose(pos[:, 2], half[:, 2], atol=1e-6)
    # The block's x axis, its depth, lies along the leg.
    yaw = values["yaw"][:, TABLE]
    np.testing.assert_allclose(np.stack((np.cos(yaw), np.sin(yaw)), -1), along(values), atol=1e-6)


def test_objects_stand_on_the_table_away_from_its_edges(fetches):
    values = fetches.values()
    start, half = values["object_start_pose"], values["object_half_extents"]
    table, centre = values["half_size"][:, TABLE], values["pos"][:, TABLE]
    np.testing.assert_allclose(start[:, 2] - half[:, 2], 2 * centre[:, 2], atol=1e-5)
    ahead, aside = in_legs_frame(start[:, :2], values)
    depth, _ = in_legs_frame(centre[:, :2], values)
    round_kinds = np.isin(values["object_kind"], [OBJECTS.index("mug"), OBJECTS.index("can")])
    radius = np.where(round_kinds, half[:, 0], np.hypot(half[:, 0], half[:, 1]))
    margin = PARAMS.table.edge_margin - 1e-5
    assert (np.abs(aside) + radius + margin <= table[:, 1]).all()
    assert (np.abs(ahead - depth) + radius + margin <= table[:, 0]).all()
    assert set(values["object_kind"]) == set(range(len(OBJECTS)))
    assert 0.8 * PARAMS.table.aside < np.abs(aside).max() <= PARAMS.table.aside + 1e-5


def test_corridor_is_that_of_the_generator(device, fetches):
    plain = Fetches(device)
    generate_layouts(plain.layout, PARAMS.corridor, counter=plain.counter, **plain.arguments(0))
    ours, theirs = fetches.values(), plain.values()
    others = np.arange(PARAMS.pool.num_slots) != TABLE
    for name in ("pos", "yaw", "half_size", "active"):
        active = theirs["active"][:, others]
        np.testing.assert_array_equal(ours[name][:, others][active], theirs[name][:, others][active])
    for name in ("start", "start_joints", "goal", "bend", "num_obstacles"):
        np.testing.assert_array_equal(ours[name], theirs[name])
    np.testing.assert_array_equal(ours["active"][:, others], theirs["active"][:, others])
    assert not theirs["active"][:, TABLE].any()


def test_same_seed_same_scene_and_masked_worlds_alone(device, fetches):
    again = Fetches(device).draw()
    before = again.values()
    for name, value in fetches.values().items():
        np.testing.assert_array_equal(before[name], value)
    mask = np.arange(NUM_WORLDS) % 3 == 0
    again.draw(mask=mask, kind=2)
    after = again.values()
    for name, value in before.items():
        np.testing.assert_array_equal(after[name][~mask], value[~mask])
    assert (after["object_kind"][mask] == 2).all()
    assert (np.abs(after["object_start_pose"] - before["object_start_pose"])[mask, :2].sum(-1) > 0).all()


def test_more_obstacles_get_a_larger_pool(device):
    params = replace(PARAMS, corridor=replace(PARAMS.corridor, hard_obstacles=7, length=8.0))
    assert params.pool.num_boxes == 7 + 2 + 1
    with pytest.raises(ValueError, match="num_boxes must be at least 10"):
        Fetches(device).draw(params=params)
    values = Fetches(device, pool=params.pool).draw(params=params).values()
    assert values["active"][:, params.table_slot].all()
    assert (values["half_size"][:, params.table_slot, 0] >= 0.25).all()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: FetchTableParams(top=(0.2, 0.5)), r"scene\.table\.top must lie in"),
        (lambda: FetchTableParams(depth=(0.6, 0.5)), r"scene\.table\.depth must be \(low, high\)"),
        (lambda: FetchTableParams(aside=-0.1), r"scene\.table\.aside must be a number"),
        (
            lambda: FetchSceneParams(table=FetchTableParams(half_width=(0.3, 0.5))),
            "half_width must be below half",
        ),
        (
            lambda: FetchSceneParams(corridor=GeneratorParams(beyond_goal=(1.0, 1.3))),
            r"beyond_goal must be at least 1\.35",
        ),
        (
            lambda: FetchSceneParams(corridor=replace(PARAMS.corridor, patrolling_share=0.5)),
            "cannot move",
        ),
    ],
)
def test_impossible_parameters_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_configuration_file_has_the_defaults_of_the_code():
    nav, ours = (OmegaConf.load(CONF_DIR / "scene" / f"{name}.yaml") for name in ("nav", "fetch"))
    merged = OmegaConf.merge({"corridor": nav}, {key: ours[key] for key in ("corridor", "table")})
    ours = OmegaConf.to_container(merged)
    assert from_mapping(FetchSceneParams, ours, "scene") == PARAMS
    assert PARAMS.pool == PoolSpec(num_boxes=8)
