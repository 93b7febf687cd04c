"""Layouts: copying scenes in and out, and fitting them into other pools."""

import numpy as np
import pytest
from scene_worlds import generate, values

from spin_rl.scenes.layout import Layout, PoolSpec, Scene

FIELDS = Layout._PER_WORLD


def test_a_scene_survives_the_round_trip_into_one_world(device):
    source, target = generate(3, device, seed=1), generate(3, device, seed=2)
    before = values(target)
    target.load(source.scene(2), world=1)
    after = values(target)
    for name in FIELDS:
        assert np.array_equal(after[name][1], values(source)[name][2]), name
        assert np.array_equal(after[name][[0, 2]], before[name][[0, 2]]), name


def test_loading_without_a_world_fills_all(device):
    layout = Layout(4, PoolSpec(), device)
    scene = generate(1, device, difficulty=2).scene(0)
    layout.load(scene)
    for other in layout.scenes():
        np.testing.assert_array_equal(other.pos, scene.pos)
        assert other.num_obstacles == 5


def test_a_larger_pool_keeps_the_scene_in_the_slots_of_its_kinds(device):
    scene = generate(1, device, seed=6, scenario=1, difficulty=2).scene(0)
    layout = Layout(1, PoolSpec(8, 9, 4), device)
    layout.load(scene)
    got = layout.scene(0)
    for kind in ("is_wall", "is_cylinder"):
        was = getattr(scene, kind) & scene.active
        now = getattr(got, kind) & got.active
        np.testing.assert_array_equal(got.pos[now], scene.pos[was])
    assert got.active.sum() == scene.active.sum()


def test_a_pool_that_is_too_small_is_named(device):
    scene = Scene.empty(PoolSpec(2, 3, 1))
    with pytest.raises(ValueError, match=r"pool.num_boxes = 3"):
        Layout(1, PoolSpec(2, 2, 1), device).load(scene)


@pytest.mark.parametrize(("pool", "key"), [((-1, 2, 2), "num_walls"), ((0, 0, 0), "slot")])
def test_impossible_pools_are_rejected(pool, key):
    with pytest.raises(ValueError, match=key):
        PoolSpec(*pool)


def test_kind_flags_follow_the_slot_order(device):
    layout = Layout(1, PoolSpec(2, 3, 1), device)
    assert layout.is_wall.numpy().tolist() == [True] * 2 + [False] * 4
    assert layout.is_cylinder.numpy().tolist() == [False] * 5 + [True]
    assert layout.pool.geom_names() == ["wall_0", "wall_1", "box_0", "box_1", "box_2", "cylinder_0"]
