"""Scandot tokens: hand-made cases, and random scenes against the oracle."""

import numpy as np
import pytest
import warp as wp
from scandot_oracle import (
    BOX,
    COLUMNS,
    CYLINDER,
    WALL,
    WINDOW_M,
    DeviceScene,
    Rays,
    box_corners,
    camera_matrix,
    in_image,
    random_scene,
    scene_in_base_frame,
    to_base,
    token_order,
    wall_samples,
)

LEVEL = camera_matrix(0.0, 0.0)
DOWN = camera_matrix(0.0, -np.pi / 2)
LEFT = camera_matrix(np.pi / 2, 0.0)
BACK = camera_matrix(np.pi, 0.0)
ROLLED = camera_matrix(0.0, 0.0, np.pi / 2)
SMALL = (0.1, 0.1, 0.1)


def box(x, y, z=1.0, half=SMALL, yaw=0.0, active=True):
    return (BOX, (x, y, z), yaw, half, active)


def wall(x, y, yaw, half=(4.0, 0.05, 0.75)):
    return (WALL, (x, y, half[2]), yaw, half, True)


def tokens(slots, device, *, cam=LEVEL, tan=(0.5, 0.5), occlusion=False, base=(1.3, -0.7, 2.1), cam_z=1.0):
    scene = scene_in_base_frame(slots, base, (0.0, 0.0, cam_z), cam, tan)
    every, visible = DeviceScene(scene, device, occlusion).run()
    return every[0], visible[0]


def corners(token):
    return token[:24].reshape(8, 3)


def known(token):
    return int(token[24:].sum())


CASES = {
    # name: (slot, camera, (tan_x, tan_y), corners in the window, corners in view)
    "inside": (box(1.5, 0.0), LEVEL, (0.5, 0.5), 8, 8),
    "behind the camera": (box(-1.0, 0.0), LEVEL, (0.5, 0.5), 8, 0),
    "nearer than the near plane": (box(0.05, 0.0, half=(0.02,) * 3), LEVEL, (5.0, 5.0), 8, 0),
    "cut by the side of the image": (box(1.0, 0.5), LEVEL, (0.5, 0.5), 8, 4),
    "cut by the top of the image": (box(1.0, 0.0, 1.5), LEVEL, (0.5, 0.5), 8, 4),
    "left of the image": (box(0.5, 1.0), LEVEL, (0.5, 0.5), 8, 0),
    "outside the window": (box(2.5, 0.0), LEVEL, (0.5, 0.5), 0, 0),
    "across the window's edge": (box(2.0, 0.0), LEVEL, (0.5, 0.5), 4, 4),
    "in the window's corner": (box(1.85, -1.85), LEVEL, (2.0, 2.0), 8, 8),
    "inactive": (box(1.5, 0.0, active=False), LEVEL, (0.5, 0.5), 0, 0),
    "left, camera panned": (box(0.0, 1.0), LEFT, (0.5, 0.5), 8, 8),
    "ahead, camera panned": (box(1.0, 0.0), LEFT, (0.5, 0.5), 8, 0),
    "below, camera pitched": (box(0.0, 0.0, 0.2), DOWN, (0.5, 0.5), 8, 8),
    "ahead, camera pitched": (box(1.5, 0.0), DOWN, (0.5, 0.5), 8, 0),
    "side, narrow landscape": (box(1.0, 0.5), LEVEL, (0.2, 0.8), 8, 0),
    "side, narrow portrait": (box(1.0, 0.5), ROLLED, (0.2, 0.8), 8, 8),
    "high, tall landscape": (box(1.0, 0.0, 1.5), LEVEL, (0.2, 0.8), 8, 8),
    "high, tall portrait": (box(1.0, 0.0, 1.5), ROLLED, (0.2, 0.8), 8, 0),
}


@pytest.mark.parametrize("name", CASES)
def test_corners_in_window_and_in_view(device, name):
    slot, cam, tan, in_window, in_view = CASES[name]
    every, visible = tokens([slot], device, cam=cam, tan=tan)
    assert (known(every[0]), known(visible[0])) == (in_window, in_view)


def test_token_layout(device):
    every, _ = tokens([box(1.0, 0.5, 0.1)], device)
    xy = [(0.9, 0.4), (1.1, 0.4), (1.1, 0.6), (0.9, 0.6)]
    expected = [(x, y, 0.0) for x, y in xy] + [(x, y, 0.2) for x, y in xy]
    np.testing.assert_allclose(corners(every[0]), expected, atol=1e-5)
    np.testing.assert_array_equal(every[0, 24:], 1.0)


def test_unknown_corners_are_zeros(device):
    _, visible = tokens([box(1.0, 0.5, 1.0)], device)
    np.testing.assert_array_equal(visible[0, 24:], [1, 1, 0, 0, 1, 1, 0, 0])
    hidden = np.repeat(visible[0, 24:] == 0.0, 3)
    np.testing.assert_array_equal(visible[0, :24][hidden], 0.0)


OCCLUSION_CASES = {
    # name: (slots, camera height, corners of slot 0 in view with line of sight)
    "own far corners": ([box(1.0, 0.0)], 1.0, 4),
    "own far bottom corners, from above": ([box(1.0, 0.0, 0.5)], 1.4, 6),
    "behind a box": ([box(1.5, 0.0), box(0.8, 0.0)], 1.0, 0),
    "behind a low box": ([box(1.5, 0.0), box(0.8, 0.0, 0.4, (0.1, 0.5, 0.4))], 1.0, 4),
    "behind a low, wide box": ([box(1.5, 0.0), box(0.8, 0.0, 0.2, (0.1, 1.0, 0.2))], 1.0, 4),
    "behind an inactive box": ([box(1.5, 0.0), box(0.8, 0.0, active=False)], 1.0, 4),
    "camera inside a box": ([box(1.5, 0.0), box(0.0, 0.0)], 1.0, 0),
    "in front of a box": ([box(0.8, 0.0), box(1.5, 0.0)], 1.0, 4),
    "behind a cylinder": ([box(1.5, 0.0), (CYLINDER, (0.7, 0.0, 1.0), 0.0, SMALL, True)], 1.0, 0),
    "behind a wall": ([box(1.5, 0.0), wall(1.0, 0.0, np.pi / 2)], 1.0, 0),
    "flush with a wall behind": ([box(1.5, 0.0), wall(1.65, 0.0, np.pi / 2)], 1.0, 4),
    # A ray to a corner at (0.9, 0.1) passes this corner of the bounding box, but not the cylinder.
    "beside a cylinder": (
        [box(1.0, 0.0), (CYLINDER, (0.7, 0.15, 1.0), 0.0, (0.065, 0.065, 0.5), True)],
        1.0,
        4,
    ),
    "beside a box": ([box(1.0, 0.0), box(0.7, 0.15, 1.0, (0.0749, 0.0749, 0.5))], 1.0, 2),
}


@pytest.mark.parametrize("name", OCCLUSION_CASES)
def test_line_of_sight(device, name):
    slots, cam_z, in_view = OCCLUSION_CASES[name]
    tan = (2.0, 2.0)
    every, visible = tokens(slots, device, occlusion=True, cam_z=cam_z, tan=tan)
    assert known(every[0]) == 8
    assert known(visible[0]) == in_view
    assert known(tokens(slots, device, occlusion=False, cam_z=cam_z, tan=tan)[1][0]) == 8


def extent(token):
    assert known(token) == 8
    return corners(token).min(0), corners(token).max(0)


@pytest.mark.parametrize("half, yaw", [((4.0, 0.05, 0.75), 0.0), ((0.05, 4.0, 0.75), np.pi / 2)])
def test_wall_is_cut_to_the_window(device, half, yaw):
    every, _ = tokens([wall(0.5, 1.0, yaw, half)], device)
    low, high = extent(every[0])
    np.testing.assert_allclose(low, [-WINDOW_M, 0.95, 0.0], atol=1e-5)
    np.testing.assert_allclose(high, [WINDOW_M, 1.05, 1.5], atol=1e-5)


@pytest.mark.parametrize(
    "x, y, yaw", [(0.0, 2.1, 0.0), (6.1, 0.0, 0.0), (0.0, -2.06, 0.0), (3.2, 3.2, -np.pi / 4)]
)
def test_wall_outside_the_window(device, x, y, yaw):
    every, visible = tokens([wall(x, y, yaw)], device, tan=(9.0, 9.0))
    assert not every.any() and not visible.any()


def test_wall_is_cut_to_the_view(device):
    _, visible = tokens([wall(1.5, 0.0, np.pi / 2)], device, cam_z=0.75)
    low, high = extent(visible[0])
    # Depth 1.45 m: the image spans +-0.725 m; of the columns at (k - 4.5) * 4/9 m, the last inside is at 2/3 m.
    np.testing.assert_allclose(low, [1.45, -2 / 3, 0.025], atol=1e-5)
    np.testing.assert_allclose(high, [1.55, 2 / 3, 1.475], atol=1e-5)


def test_wall_behind_the_camera(device):
    every, visible = tokens([wall(1.5, 0.0, np.pi / 2)], device, cam=BACK)
    assert known(every[0]) == 8 and not visible.any()


def test_wall_seen_between_its_sampled_heights(device):
    # Close to the camera, the image holds neither the wall's foot, nor its middle, nor its top.
    _, visible = tokens([wall(0.35, 0.0, np.pi / 2)], device, cam_z=1.1, tan=(1.0, 0.5))
    low, high = extent(visible[0])
    np.testing.assert_allclose([low[2], high[2]], [0.95, 1.25], atol=1e-5)


def test_wall_partly_hidden(device):
    screen = box(0.75, -1.0, 0.75, (0.1, 1.0, 0.75))
    _, visible = tokens([wall(1.5, 0.0, np.pi / 2), screen], device, cam_z=0.75, occlusion=True)
    low, high = extent(visible[0])
    np.testing.assert_allclose([low[1], high[1]], [2 / 9, 2 / 3], atol=1e-5)


def test_wall_hidden(device):
    screen = box(0.75, 0.0, 0.75, (0.1, 1.0, 0.75))
    every, visible = tokens([wall(1.5, 0.0, np.pi / 2), screen], device, cam_z=0.75, occlusion=True)
    assert known(every[0]) == 8 and not visible[0].any()


def flags_near_a_limit(scene, world, points):
    """Points whose window or frustum test flips within a tenth of a millimetre (float32 cannot decide them)."""
    steps = 1e-4 * np.concatenate([np.eye(3), -np.eye(3)])
    moved = points[:, None] + steps
    views = in_image(scene, world, moved.reshape(-1, 3)).reshape(moved.shape[:2])
    local = np.abs(to_base(scene, world, moved)[..., :2]).max(-1) <= WINDOW_M
    return (views != views[:, :1]).any(1) | (local != local[:, :1]).any(1)


@pytest.mark.parametrize("occlusion", [False, True])
def test_random_boxes_and_cylinders(device, occlusion):
    scene = random_scene(np.random.default_rng(3), 24)
    every, visible = DeviceScene(scene, device, occlusion).run()
    checked = skipped = seen = 0
    for world in range(24):
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
    assert checked > 1500 and skipped < 0.03 * checked and seen > 50


def wall_extent(scene, world, slot, sees):
    """Along (from the piece's start) and height extents of the samples seen, and whether all of it is certain."""
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
    assert known(token) == 8
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
