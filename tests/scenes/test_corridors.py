"""Properties of generated corridors."""

import dataclasses

import mujoco
import numpy as np
import pytest
import warp as wp
from scene_worlds import PARAMS, corners, distractors, generate, inputs, legs, obstacles, values
from scipy import ndimage

from spin_rl import robot
from spin_rl.scenes.builder import native_model
from spin_rl.scenes.corridors.generator import generate_layouts
from spin_rl.scenes.corridors.params import GeneratorParams
from spin_rl.scenes.layout import Layout, PoolSpec

CELLS = [(scenario, difficulty) for scenario in (1, 2) for difficulty in (0, 1, 2)]


def test_only_masked_worlds_change(device):
    layout = generate(8, device, seed=1)
    before = values(layout)
    mask = np.arange(8) % 3 == 0
    arguments = inputs(8, device, seed=2, mask=mask)
    generate_layouts(layout, PARAMS, **arguments)
    after = values(layout)
    for name in before:
        assert np.array_equal(before[name][~mask], after[name][~mask]), name
    for world in np.flatnonzero(mask):
        assert not np.array_equal(before["start"][world], after["start"][world])
    assert arguments["counter"].numpy().tolist() == mask.astype(int).tolist()


def test_the_same_seed_gives_the_same_bits_and_another_draw_does_not(device):
    first, second = generate(16, device, seed=7), generate(16, device, seed=7)
    for name, value in values(first).items():
        assert np.array_equal(value, values(second)[name]), name
    starts = values(first)["start"]
    assert len(np.unique(starts[:, 2])) == 16
    assert not np.isin(values(generate(16, device, seed=8))["start"][:, 2], starts[:, 2]).any()
    arguments = inputs(16, device, seed=7)
    generate_layouts(second, PARAMS, **arguments)
    generate_layouts(second, PARAMS, **arguments)
    assert not np.isin(values(second)["start"][:, 2], starts[:, 2]).any()


def test_a_world_does_not_depend_on_the_number_of_worlds(device):
    few, many = values(generate(4, device, seed=3)), values(generate(64, device, seed=3))
    for name in few:
        assert np.array_equal(few[name], many[name][:4]), name


def test_graph_replay_equals_eager(device):
    eager, replayed = Layout(32, PoolSpec(), device), Layout(32, PoolSpec(), device)
    arguments, captured = inputs(32, device, seed=5), inputs(32, device, seed=5)
    generate_layouts(Layout(32, PoolSpec(), device), PARAMS, **inputs(32, device))
    with wp.ScopedDevice(device):
        with wp.ScopedCapture() as capture:
            generate_layouts(replayed, PARAMS, **captured)
        for _ in range(3):
            generate_layouts(eager, PARAMS, **arguments)
            wp.capture_launch(capture.graph)
    assert captured["counter"].numpy().tolist() == [3] * 32
    for name, value in values(eager).items():
        assert np.array_equal(value, values(replayed)[name]), name


@pytest.mark.parametrize(("scenario", "difficulty"), CELLS)
def test_counts_and_labels_of_a_cell(scenario, difficulty, device):
    layout = generate(256, device, scenario=scenario, difficulty=difficulty)
    got = values(layout)
    assert set(got["num_obstacles"]) == ({0, 1}, {2, 3}, {5})[difficulty]
    assert (got["scenario"] == scenario).all() and (got["bend"] == scenario - 1).all()
    assert (got["difficulty"] == difficulty).all()
    active = got["active"]
    assert (active[:, :6].sum(axis=1) == (4 if scenario == 1 else 6)).all()
    extra = active[:, 6:].sum(axis=1) - got["num_obstacles"]
    assert set(extra) == {1, 2}
    path = np.abs(got["goal"]).sum(axis=1)
    assert path == pytest.approx(np.full(256, PARAMS.length), abs=1e-5)
    assert scenario == 1 or set(np.sign(got["goal"][:, 1])) == {-1.0, 1.0}


def test_a_random_mix_has_every_cell(device):
    got = values(generate(600, device))
    for scenario, difficulty in CELLS:
        share = ((got["scenario"] == scenario) & (got["difficulty"] == difficulty)).mean()
        assert 0.1 < share < 0.24


def test_the_curriculum_limits_width_and_count(device):
    for level, width, most in ((0.0, 1.6, 1), (0.5, 1.3, 3), (1.0, 1.0, 5)):
        layout = generate(200, device, scenario=1, level=level)
        got = values(layout)
        room = got["pos"][:, 0, 1] - got["half_size"][:, 0, 1]
        assert room == pytest.approx(np.full(200, 0.5 * width), abs=1e-5)
        assert got["num_obstacles"].max() == most
    fixed = values(generate(50, device, difficulty=2, level=0.0))
    assert (fixed["num_obstacles"] == 5).all()


@pytest.mark.parametrize("level", [0.0, 1.0])
def test_walls_close_the_corridor_without_gap_or_overlap(level, device):
    width = PARAMS.easy_width + level * (PARAMS.width - PARAMS.easy_width)
    cell = 0.01
    for scene in generate(6, device, level=level).scenes():
        x = np.arange(-1.5, 7.0, cell) + 0.5 * cell
        y = np.arange(-5.0, 5.0, cell) + 0.5 * cell
        count = np.zeros((len(y), len(x)), dtype=int)
        for slot in np.flatnonzero(scene.active & scene.is_wall):
            centre, half = scene.pos[slot], scene.half_size[slot]
            count += (np.abs(y[:, None] - centre[1]) < half[1]) & (np.abs(x - centre[0]) < half[0])
        assert count.max() == 1
        regions, _ = ndimage.label(count == 0)
        inside = regions == regions[np.argmin(np.abs(y)), np.argmin(np.abs(x))]
        area = sum(float(np.prod(high - low)) for low, high in legs(scene, width))
        area -= width**2 if scene.bend else 0.0
        assert inside.sum() * cell**2 == pytest.approx(area, abs=0.15)


@pytest.mark.parametrize(("scenario", "level"), [(1, 0.0), (1, 1.0), (2, 0.0), (2, 1.0)])
def test_obstacles_are_inside_and_leave_a_passage(scenario, level, device):
    width = PARAMS.easy_width + level * (PARAMS.width - PARAMS.easy_width)
    for scene in generate(150, device, scenario=scenario, difficulty=2, level=level).scenes():
        rectangles = legs(scene, width)
        for slot in obstacles(scene):
            points = corners(scene, slot)
            fits = [
                leg for leg in rectangles if (points > leg[0] - 1e-4).all() and (points < leg[1] + 1e-4).all()
            ]
            assert fits, (scene.pos[slot], scene.half_size[slot])
            # The leg's short side is the one across.
            across = int(np.argmin(fits[0][1] - fits[0][0]))
            low, high = (
                points[:, across].min() - fits[0][0][across],
                fits[0][1][across] - points[:, across].max(),
            )
            assert max(low, high) >= PARAMS.passage - 1e-4
            along = np.abs(points[:, 0]).min() if across == 1 and not scene.bend else np.inf
            assert along >= 0.0585 + PARAMS.first_obstacle - 1e-4
        for slot in distractors(scene):
            points = corners(scene, slot)
            for low, high in rectangles:
                assert (points.max(axis=0) < low).any() or (points.min(axis=0) > high).any()


def test_obstacles_on_opposite_sides_leave_room_to_swing(device):
    for scene in generate(200, device, scenario=1, difficulty=2).scenes():
        spans = sorted(
            (c[:, 0].min(), c[:, 0].max(), c[:, 1].min(), c[:, 1].max())
            for c in (corners(scene, slot) for slot in obstacles(scene))
        )
        for i, (_, end, low, high) in enumerate(spans):
            for begin, _, next_low, next_high in spans[i + 1 :]:
                assert begin > end
                # What is free beside both at the same y.
                left = 0.5 - max(high, next_high)
                right = min(low, next_low) + 0.5
                between = max(next_low - high, low - next_high)
                if max(left, right, between) < PARAMS.passage - 1e-4:
                    assert begin - end > PARAMS.slalom_gap - 1e-4


def test_heights_follow_the_shares(device):
    bottoms, tops = [], []
    for scene in generate(400, device, difficulty=2).scenes():
        for slot in obstacles(scene):
            bottoms.append(scene.pos[slot, 2] - scene.half_size[slot, 2])
            tops.append(scene.pos[slot, 2] + scene.half_size[slot, 2])
    bottom, top = np.array(bottoms), np.array(tops)
    floor = bottom < 1e-5
    low, tall = floor & (top <= 0.2501), floor & (top >= 0.6999)
    arm, head = (bottom > 0.399) & (bottom < 0.801), (bottom > 1.049) & (bottom < 1.251)
    assert (low | tall | arm | head).all()
    for kind, share in ((low, 0.45), (tall, 0.10), (arm, 0.15), (head, 0.30)):
        assert kind.mean() == pytest.approx(share, abs=0.04)


def test_some_obstacles_hide_behind_the_corner(device):
    hidden = 0
    scenes = generate(200, device, scenario=2, difficulty=2).scenes()
    for scene in scenes:
        side = np.sign(scene.goal[1])
        inner = scene.goal[0] - 0.5
        # Near the inner wall of the second leg, within 0.3 m of the corner's square.
        hidden += any(
            points[:, 0].min() < inner + 0.35 and 0.5 < (side * points[:, 1]).min() < 0.8
            for points in (corners(scene, slot) for slot in obstacles(scene))
        )
    assert 0.4 < hidden / len(scenes) < 0.95


def test_start_poses_are_random_and_within_limits(device):
    got = values(generate(500, device, difficulty=2))
    yaw = got["start"][:, 2]
    assert (np.histogram(yaw, bins=8, range=(-np.pi, np.pi))[0] > 20).all()
    assert (yaw == 0.0).mean() < 0.05
    joints = got["start_joints"]
    assert (joints >= np.array(robot.JOINT_LOWER) - 1e-6).all()
    assert (joints <= np.array(robot.JOINT_UPPER) + 1e-6).all()
    assert np.ptp(joints[:, robot.JOINTS.index("head_pan")]) > 4.5
    assert np.ptp(joints[:, robot.JOINTS.index("head_tilt")]) > 1.8
    assert np.ptp(joints[:, robot.JOINTS.index("lift")]) > 0.5


@pytest.mark.parametrize("scenario", [1, 2])
def test_start_poses_are_clear_in_mujoco(scenario, device):
    """Distances between the robot's real collision geoms and the scene, by another program."""
    for scene in generate(60, device, seed=9, scenario=scenario, difficulty=2).scenes():
        model = native_model(scene)
        data = mujoco.MjData(model)
        limited = np.clip(scene.start_joints, robot.JOINT_LOWER, robot.JOINT_UPPER)
        data.qpos[:] = robot.qpos_from_joints(model, dict(zip(robot.JOINTS, limited.tolist(), strict=True)))
        data.qpos[:3] = scene.start
        mujoco.mj_forward(model, data)
        assert data.ncon == 0
        collides = (model.geom_contype | model.geom_conaffinity) != 0
        own = np.flatnonzero(collides & (model.geom_bodyid != 0))
        others = [g for g in np.flatnonzero(model.geom_bodyid == 0) if model.geom(g).name != "floor"]
        for geom in own:
            for other in others:
                distance = mujoco.mj_geomDistance(model, data, int(geom), int(other), 0.2, None)
                assert distance > PARAMS.start_clearance - 1e-3, (
                    model.geom(geom).name,
                    model.geom(other).name,
                )


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"passage": 0.3}, "scene.passage"),
        ({"width": 0.5}, "scene.width"),
        ({"width": float("nan")}, "scene.width"),
        ({"low_top": (0.3, 0.1)}, "scene.low_top"),
        ({"low_top": (0.1, float("inf"))}, "scene.low_top"),
        ({"head_share": 0.9}, "head_share"),
        ({"first_leg": (0.5, 3.0)}, "scene.first_leg"),
        ({"start_lift": (0.2, 2.0)}, "scene.start_lift"),
        ({"start_tries": 0}, "scene.start_tries"),
    ],
)
def test_bad_parameters_are_named(change, key):
    with pytest.raises(ValueError, match=key):
        dataclasses.replace(GeneratorParams(), **change)


@pytest.mark.parametrize(
    ("pool", "key"), [(PoolSpec(5, 7, 3), "num_walls"), (PoolSpec(6, 4, 3), "num_boxes")]
)
def test_small_pools_are_rejected(pool, key, device):
    with pytest.raises(ValueError, match=key):
        generate(2, device, pool=pool)


def test_a_pool_without_cylinders_or_spare_boxes_works(device):
    got = values(generate(64, device, pool=PoolSpec(6, 5, 0), difficulty=2))
    assert (got["num_obstacles"] == 5).all()
    assert got["active"][:, 6:].all()
