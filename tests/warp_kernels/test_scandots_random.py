"""Scandot tokens of random scenes: against the oracle, and properties that hold for any scene."""

import numpy as np
import pytest
import warp as wp
from scandot_oracle import (
    COLUMNS,
    WALL,
    WINDOW_M,
    DeviceScene,
    Rays,
    box_corners,
    in_image,
    random_scene,
    to_base,
    token_order,
    wall_samples,
)


def corners(token):
    return token[:24].reshape(8, 3)


def flags_near_a_limit(scene, world, points):
    """Points whose window or frustum test flips within 0.1 mm: float32 cannot decide them."""
    steps = 1e-4 * np.concatenate([np.eye(3), -np.eye(3)])
    moved = points[:, None] + steps
    views = in_image(scene, world, moved.reshape(-1, 3)).reshape(moved.shape[:2])
    local = np.abs(to_base(scene, world, moved)[..., :2]).max(-1) <= WINDOW_M
    return (views != views[:, :1]).any(1) | (local != local[:, :1]).any(1)


@pytest.mark.parametrize("occlusion", [False, True])
def test_random_boxes_and_cylinders(device, occlusion):
    scene = random_scene(np.random.default_rng(3), 200)
    every, visible = DeviceScene(scene, device, occlusion).run()
    checked = skipped = seen = 0
    for world in range(200):
        rays = Rays(scene, world)
        for slot in np.flatnonzero(scene.kind != WALL):
            points = box_corners(scene.pos[world, slot], scene.yaw[world, slot], scene.half_size[world, slot])
            points = points[token_order(to_base(scene, world, points))]
            local = to_base(scene, world, points)
            inside = (np.abs(local[:, :2]).max(1) <= WINDOW_M) & scene.active[world, slot]
            view = inside & in_image(scene, world, points)
            unsure = flags_near_a_limit(scene, world, points)
            if occlusion:
                for i in np.flatnonzero(view):
                    unsure[i] |= not rays.is_clear_cut(points[i])
                    view[i] = rays.sees(points[i])
            sure = ~unsure
            checked, skipped, seen = checked + sure.sum(), skipped + unsure.sum(), seen + view.sum()
            for token, flags in ((every[world, slot], inside), (visible[world, slot], view)):
                np.testing.assert_array_equal(token[24:][sure], flags[sure])
                np.testing.assert_allclose(corners(token)[sure], (local * flags[:, None])[sure], atol=1e-5)
    assert checked > 12000 and skipped < 0.03 * checked and seen > 500


def wall_extent(scene, world, slot, sees):
    """Ends of the piece in the window; (along, height) of the samples seen; whether that is certain."""
    ends = wall_samples(scene, world, slot)
    if ends is None:
        return None, None, True
    length = np.linalg.norm(ends[1] - ends[0])
    height = 2 * scene.half_size[world, slot, 2]
    z = np.linspace(0.0, height, 8001)
    found, certain = [], True
    for share in np.linspace(0.0, 1.0, COLUMNS):
        foot = ends[0] + share * (ends[1] - ends[0])
        column = foot + np.outer(z, [0.0, 0.0, 1.0])
        inside = in_image(scene, world, column)
        if inside.sum() < 20:
            certain &= not inside.any()
            continue
        first, last = column[inside][[0, -1]]
        for point in (first, (first + last) / 2, last):
            visible, clear = sees(point)
            certain &= clear
            if visible:
                found.append((share * length, point[2]))
    return ends, np.array(found), certain


@pytest.mark.parametrize("occlusion", [False, True])
def test_random_walls(device, occlusion):
    scene = random_scene(np.random.default_rng(5), 40)
    every, visible = DeviceScene(scene, device, occlusion).run()
    outcomes = {"outside": 0, "unseen": 0, "seen": 0, "unsure": 0}
    for world in range(40):
        rays = Rays(scene, world)
        for slot in np.flatnonzero(scene.kind == WALL):
            if not scene.active[world, slot]:
                assert not every[world, slot].any() and not visible[world, slot].any()
                continue
            ends, found, certain = wall_extent(
                scene,
                world,
                slot,
                lambda p, rays=rays: (rays.sees(p), rays.is_clear_cut(p)) if occlusion else (True, True),
            )
            if ends is None:
                outcomes["outside"] += 1
                assert not every[world, slot].any() and not visible[world, slot].any()
                continue
            pos, half = scene.pos[world, slot], scene.half_size[world, slot]
            check_piece(scene, world, slot, every[world, slot], ends, (pos[2] - half[2], pos[2] + half[2]))
            if not certain:
                outcomes["unsure"] += 1
            elif len(found) == 0:
                outcomes["unseen"] += 1
                assert not visible[world, slot].any()
            else:
                outcomes["seen"] += 1
                along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
                (low, bottom), (high, top) = found.min(0), found.max(0)
                piece = np.stack([ends[0] + low * along, ends[0] + high * along])
                check_piece(scene, world, slot, visible[world, slot], piece, (bottom, top))
    assert min(outcomes["outside"], outcomes["unseen"], outcomes["seen"]) >= 5
    assert outcomes["unsure"] < 5, outcomes


def check_piece(scene, world, slot, token, ends, heights):
    """Compare a token with the box on a wall's face between two points and two heights."""
    half = scene.half_size[world, slot]
    thickness = 2 * min(half[:2])
    along = ends[1] - ends[0]
    centre = scene.pos[world, slot]
    away = np.array([centre[0] - ends[0][0], centre[1] - ends[0][1], 0.0])
    unit = box_axis(scene, world, slot)
    away -= (away @ unit) * unit
    away *= thickness / np.linalg.norm(away)
    foot = np.stack([ends[0], ends[0] + along, ends[0] + away, ends[0] + along + away])
    points = np.concatenate([np.column_stack([foot[:, :2], np.full(4, z)]) for z in heights])
    expected = to_base(scene, world, points)
    np.testing.assert_array_equal(token[24:], 1.0)
    # As sets: the order of a piece that is nearly square to the base is decided by rounding.
    distance = np.linalg.norm(corners(token)[:, None] - expected[None], axis=-1)
    assert distance.min(1).max() < 2e-3 and distance.min(0).max() < 2e-3


def box_axis(scene, world, slot):
    half, yaw = scene.half_size[world, slot], scene.yaw[world, slot]
    turn = yaw + (np.pi / 2 if half[1] > half[0] else 0.0)
    return np.array([np.cos(turn), np.sin(turn), 0.0])


def test_occlusion_only_removes_and_visible_is_part_of_all(device):
    scene = random_scene(np.random.default_rng(11), 32)
    every, free = DeviceScene(scene, device, False).run()
    same, sight = DeviceScene(scene, device, True).run()
    np.testing.assert_array_equal(every, same)
    not_wall = scene.kind != WALL
    assert np.all(sight[..., 24:] <= free[..., 24:]) and np.all(free[..., 24:] <= every[..., 24:])
    assert sight[:, not_wall, 24:].sum() < free[:, not_wall, 24:].sum()
    for inner, outer in ((sight, free), (free, every)):
        shown = np.repeat(inner[:, not_wall, 24:], 3, axis=-1) == 1.0
        np.testing.assert_array_equal(inner[:, not_wall, :24][shown], outer[:, not_wall, :24][shown])
        seen = inner[:, ~not_wall, 24] == 1.0
        small = inner[:, ~not_wall][seen][:, :24].reshape(-1, 8, 3)
        large = outer[:, ~not_wall][seen][:, :24].reshape(-1, 8, 3)
        assert np.all(small.min(1) >= large.min(1) - 1e-5) and np.all(small.max(1) <= large.max(1) + 1e-5)


def test_worlds_do_not_mix(device):
    scene = random_scene(np.random.default_rng(7), 5)
    every, visible = DeviceScene(scene, device, True).run()
    for world in range(5):
        alone = DeviceScene(scene.world(world), device, True).run()
        np.testing.assert_array_equal(every[world], alone[0][0])
        np.testing.assert_array_equal(visible[world], alone[1][0])


def test_permuted_slots_permute_tokens(device):
    rng = np.random.default_rng(13)
    scene = random_scene(rng, 6)
    every, visible = DeviceScene(scene, device, True).run()
    order = rng.permutation(len(scene.kind))
    for name in ("pos", "yaw", "half_size", "active"):
        setattr(scene, name, getattr(scene, name)[:, order])
    scene.kind = scene.kind[order]
    every_p, visible_p = DeviceScene(scene, device, True).run()
    np.testing.assert_array_equal(every_p, every[:, order])
    np.testing.assert_array_equal(visible_p, visible[:, order])


def test_graph_replay_equals_eager(device):
    scene = random_scene(np.random.default_rng(17), 4)
    replayed = DeviceScene(scene, device, True)
    replayed.launch()
    with wp.ScopedCapture(device=device) as capture:
        replayed.launch()
    scene.base = scene.base + [0.3, -0.2, 0.5]
    moved = DeviceScene(scene, device, True)
    every, visible = moved.run()
    replayed.base.assign(moved.base)
    wp.capture_launch(capture.graph)
    np.testing.assert_array_equal(replayed.all.numpy(), every)
    np.testing.assert_array_equal(replayed.visible.numpy(), visible)
