"""Scandot tokens: hand-made cases."""

import numpy as np
import pytest
from scandot_oracle import BOX, CYLINDER, WALL, WINDOW_M, DeviceScene, camera_matrix, scene_in_base_frame

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


def tokens(
    slots,
    device,
    *,
    cam=LEVEL,
    tan=(0.5, 0.5),
    occlusion=False,
    base=(1.3, -0.7, 2.1),
    cam_z=1.0,
    pieces_from=0.0,
):
    scene = scene_in_base_frame(slots, base, (0.0, 0.0, cam_z), cam, tan)
    every, visible = DeviceScene(scene, device, occlusion, pieces_from).run()
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
    "3 cm behind a thin board": ([box(1.0, 0.0), box(0.872, 0.0, half=(0.002, 0.5, 0.5))], 1.0, 0),
    "1 cm behind a thin board": ([box(1.0, 0.0), box(0.892, 0.0, half=(0.002, 0.5, 0.5))], 1.0, 4),
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
    # Depth 1.45 m: the image spans +-0.725 m; the last column (k - 4.5) * 4/9 m inside is at 2/3 m.
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


COUCH = (0.2, 0.9, 0.4)


def test_a_couch_right_before_the_camera_is_seen_by_pieces_alone(device):
    couch = box(1.0, 0.0, 0.9, half=COUCH)
    assert known(tokens([couch], device)[1][0]) == 0
    every, visible = tokens([couch], device, pieces_from=0.5)
    assert known(every[0]) == known(visible[0]) == 8
    # Of its face at 0.8 m, what of the ten lines is in the image, half of that distance to either side.
    y = np.abs(corners(visible[0])[:, 1])
    assert 0.2 < y.min() and y.max() <= 0.4 + 1e-5
    assert corners(every[0])[:, 1].max() == pytest.approx(0.9, abs=1e-5)
    assert sorted(set(corners(visible[0])[:, 0].round(4))) == [0.8, 1.2]


@pytest.mark.parametrize("yaw", [0.0, 0.4, -1.2, 2.0])
@pytest.mark.parametrize("x", [0.7, 1.2])
def test_a_piece_of_a_long_slot_is_that_of_a_wall(x, yaw, device):
    other = box(0.5, 0.1, 0.9, half=(0.05, 0.05, 0.3))
    half = (0.1, 0.8, 0.7)
    long = (BOX, (x, 0.3, 0.7), yaw, half, True)
    as_wall = (WALL, *long[1:])
    by_piece = tokens([long, other], device, occlusion=True, pieces_from=1.0)
    expected = tokens([as_wall, other], device, occlusion=True)
    np.testing.assert_array_equal(by_piece[0], expected[0])
    np.testing.assert_array_equal(by_piece[1], expected[1])
    assert known(by_piece[0][0]) == 8


def test_right_before_its_end_a_long_slot_is_told_by_that(device):
    shelf = box(1.5, 0.0, 0.9, half=(0.6, 0.15, 0.5))
    every, visible = tokens([shelf], device, pieces_from=0.5, occlusion=True)
    assert known(visible[0]) == 8
    assert np.abs(corners(visible[0])[:, 1]).max() == pytest.approx(0.15, abs=1e-5)
    assert corners(visible[0])[:, 0].min() == pytest.approx(0.9, abs=1e-5)
    assert known(every[0]) == 8


def test_what_is_high_is_told_by_pieces_too(device):
    person = box(1.0, 0.0, 0.85, half=(0.2, 0.2, 0.85))
    assert known(tokens([person], device)[1][0]) == 0
    visible = tokens([person], device, pieces_from=0.5)[1]
    assert known(visible[0]) == 8
    heights = corners(visible[0])[:, 2]
    assert heights.min() == pytest.approx(0.6, abs=0.01) and heights.max() == pytest.approx(1.4, abs=0.01)
