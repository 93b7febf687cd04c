"""The robot's depth filter against the simulator's, and the reduction of a camera's image."""

import numpy as np
import pytest
import warp as wp

from spin_rl.sensors.depth.filter import DepthFilter
from spin_rl.sensors.depth.filter_config import DepthFilterConfig
from spin_rl.sensors.depth.robot import RobotDepthFilter, resample_depth

ROWS, COLS = 24, 36
ALL_STEPS = DepthFilterConfig(
    dilate_px=1, close_px=4, fill_px=3, median_support=2, blur=0.5, memory=0.5, hold_steps=3
)
FILTERS = {
    "nothing": DepthFilterConfig(),
    "all": ALL_STEPS,
    "dilate": DepthFilterConfig(dilate_px=3),
    "close": DepthFilterConfig(close_px=5),
    "fill": DepthFilterConfig(fill_px=2),
    "median": DepthFilterConfig(median_support=9),
    "blur": DepthFilterConfig(blur=1.0, surface_jump=0.3),
    "hold": DepthFilterConfig(hold_steps=1, memory=0.9, memory_change=0.4, near_m=1.0, far_m=1.5),
}


def image_with_holes(seed):
    rng = np.random.default_rng(seed)
    image = rng.uniform(1.0, 1.3, (ROWS, COLS)).astype(np.float32)
    image[rng.random(image.shape) < 0.2] = 0.0
    image[3:20, 5:25] = 0.0 if seed % 10 == 2 else 2.0
    return image


@pytest.mark.parametrize("steps", FILTERS)
@pytest.mark.parametrize("mount", ["landscape", "portrait"])
def test_robot_gets_what_the_simulation_gets(device, mount, steps):
    measured = wp.zeros((2, ROWS, COLS), dtype=float, device=device)
    simulated = DepthFilter(measured, FILTERS[steps], stereo_along_rows=mount == "landscape")
    robot = RobotDepthFilter(FILTERS[steps], (ROWS, COLS), mount=mount)
    ended = wp.array([False, True], dtype=bool, device=device)
    for episode in range(2):
        for t in range(3):
            image = image_with_holes(10 * episode + t)
            measured.assign(np.stack([image_with_holes(0), image]))
            simulated.update()
            # The camera's right is down: turned back, the last column of the upright image is its first row.
            policy = robot(image if mount == "landscape" else image.T[::-1])
            assert policy.dtype == np.float32
            np.testing.assert_allclose(policy, simulated.policy.numpy()[1], atol=1e-5)
            np.testing.assert_allclose(robot.depth, simulated.depth.numpy()[1], atol=1e-5)
        robot.reset()
        simulated.begin(ended)


def test_robot_takes_the_cameras_own_images(device):
    robot = RobotDepthFilter(DepthFilterConfig(near_m=0.0, far_m=4.0))
    image = np.full((480, 848), 3.0)
    image[:, 424:] = 1.0  # the camera's right, which is down
    image[:240] = np.nan  # its top, which is to the right
    policy = robot(image)
    np.testing.assert_array_equal(policy[:, 29:], 1.0)
    np.testing.assert_array_equal(policy[:43, :29], 0.75)
    np.testing.assert_array_equal(policy[44:, :29], 0.25)
    with pytest.raises(ValueError, match="mount"):
        RobotDepthFilter(DepthFilterConfig(), mount="sideways")


@pytest.mark.parametrize(
    "block, expected",
    [
        ([1, 2, 3, 4, 5, 6, 7, 8, 9], 5.0),
        ([1, 1, 1, 1, 3, 3, 3, 3, 3], 3.0),
        ([0, 0, 0, 0, 0, 0, 0, 0, 2], 2.0),
        ([0, 0, 0, 0, 0, np.nan, np.inf, 2, 3], 2.0),
        ([0] * 9, 0.0),
    ],
)
def test_resampling_takes_the_median_of_what_is_measured(block, expected):
    image = np.tile(np.reshape(block, (3, 3)), (4, 5))
    np.testing.assert_array_equal(resample_depth(image, 4, 5), np.full((4, 5), expected))


def test_resampling_keeps_an_image_of_the_right_size():
    image = image_with_holes(0)
    np.testing.assert_array_equal(resample_depth(image, ROWS, COLS), image)
    with pytest.raises(ValueError, match="at least"):
        resample_depth(image, ROWS + 1, COLS)
