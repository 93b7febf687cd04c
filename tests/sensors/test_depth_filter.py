"""Hole filling, smoothing and the temporal filter, against scipy and on synthetic holes."""

import numpy as np
import pytest
import warp as wp
from scipy import ndimage

from spin_rl.sensors.depth.filter import DepthFilter
from spin_rl.sensors.depth.filter_config import MAX_REACH_PX, DepthFilterConfig
from spin_rl.warp_kernels.images.holes import MAX_REACH

ROWS, COLS = 24, 36
MAX_DEPTH = 10.0
FILL = DepthFilterConfig(dilate_px=1, close_px=4, fill_px=3)
EVERYTHING = DepthFilterConfig(
    dilate_px=1, close_px=4, fill_px=3, median_support=2, blur=0.5, memory=0.5, hold_steps=3
)


class Rig:
    """A filter whose measured images the test sets."""

    def __init__(self, device, config, num_worlds=1, shape=(ROWS, COLS), **options):
        self.measured = wp.zeros((num_worlds, *shape), dtype=float, device=device)
        self.filter = DepthFilter(self.measured, config, **options)

    def begin(self, worlds):
        mask = np.isin(np.arange(self.measured.shape[0]), worlds)
        self.filter.begin(wp.array(mask, dtype=bool, device=self.measured.device))

    def show(self, images):
        self.measured.assign(np.broadcast_to(np.asarray(images, dtype=np.float32), self.measured.shape))

    def apply(self, images):
        self.show(images)
        self.filter.update()
        return self.filter.depth.numpy().copy()


def plane():
    """A slope from 1.5 m to 3 m."""
    rows, cols = np.mgrid[:ROWS, :COLS]
    return (1.5 + 0.02 * cols + 0.03 * rows).astype(np.float32)


def noisy_holes(seed, share):
    """A random image with single holes and a block of them, and one at the border."""
    rng = np.random.default_rng(seed)
    image = rng.uniform(0.5, 4.0, (ROWS, COLS)).astype(np.float32)
    image[rng.random(image.shape) < share] = 0.0
    image[8:17, 10:19] = 0.0
    image[:5, 30:] = 0.0
    return image


def inverted(image):
    return np.where(image > 0.0, MAX_DEPTH - image, 0.0)


def reinverted(image):
    return np.where(image > 0.0, MAX_DEPTH - image, 0.0)


def dilated(image, footprint):
    return ndimage.grey_dilation(image, footprint=footprint, mode="constant", cval=0.0)


def closed(image, longest):
    """Close runs of holes in rows, each with the shortest segment that bridges it."""
    for gap in range(1, longest + 1):
        padded = np.pad(image, ((0, 0), (gap, gap)))
        bridged = ndimage.grey_closing(padded, size=(1, gap + 1))[:, gap:-gap]
        image = np.where(image > 0.0, image, bridged)
    return image


@pytest.mark.parametrize("share", [0.03, 0.3, 0.8])
def test_filling_is_dilation_closing_dilation_of_inverted_depth(device, share):
    image = noisy_holes(1, share)
    expected = inverted(image)
    diamond = ndimage.generate_binary_structure(2, 1)
    expected = np.where(expected > 0.0, expected, dilated(expected, diamond))
    expected = closed(expected, 4)
    expected = np.where(expected > 0.0, expected, dilated(expected, np.ones((7, 7))))
    np.testing.assert_allclose(Rig(device, FILL).apply(image)[0], reinverted(expected), atol=1e-5)


@pytest.mark.parametrize(
    "options, footprint",
    [
        ({"dilate_px": 2}, [[0, 0, 1, 0, 0], [0, 1, 1, 1, 0], [1] * 5, [0, 1, 1, 1, 0], [0, 0, 1, 0, 0]]),
        ({"fill_px": 2}, np.ones((5, 5))),
        ({"fill_px": 8}, np.ones((17, 17))),
    ],
)
def test_each_dilation_alone(device, options, footprint):
    image = noisy_holes(2, 0.5)
    expected = np.where(image > 0.0, inverted(image), dilated(inverted(image), np.array(footprint)))
    filled = Rig(device, DepthFilterConfig(**options)).apply(image)[0]
    np.testing.assert_allclose(filled, reinverted(expected), atol=1e-5)


def test_closing_alone_and_along_either_axis(device):
    image = noisy_holes(3, 0.5)
    config = DepthFilterConfig(close_px=3)
    expected = reinverted(closed(inverted(image), 3))
    np.testing.assert_allclose(Rig(device, config).apply(image)[0], expected, atol=1e-5)
    upright = Rig(device, config, shape=(COLS, ROWS), stereo_along_rows=False).apply(image.T)[0]
    np.testing.assert_allclose(upright, expected.T, atol=1e-5)


def test_everything_off_only_scales(device):
    image = noisy_holes(4, 0.1)
    rig = Rig(device, DepthFilterConfig(near_m=0.5, far_m=3.0))
    np.testing.assert_array_equal(rig.apply(image)[0], image)
    expected = np.where(image > 0.0, np.clip((image - 0.5) / 2.5, 0.0, 1.0), 1.0)
    np.testing.assert_allclose(rig.filter.policy.numpy()[0], expected, atol=1e-6)


def test_a_constant_image_stays(device):
    rig = Rig(device, EVERYTHING)
    for _ in range(3):
        np.testing.assert_allclose(rig.apply(np.full((ROWS, COLS), 1.7))[0], 1.7, rtol=1e-6)
    np.testing.assert_allclose(rig.filter.policy.numpy(), 1.5 / 3.8, rtol=1e-5)


def test_holes_in_a_slope_are_filled_within_tolerance(device):
    image = plane()
    holes = np.random.default_rng(0).random(image.shape) < 0.15
    holes[10:13, 14:20] = True
    filtered = Rig(device, EVERYTHING).apply(np.where(holes, 0.0, image))[0]
    assert (filtered > 0.0).all()
    assert np.abs(filtered - image).max() < 0.12
    assert np.abs(filtered - image)[~holes].max() < 0.03


def test_a_shadow_takes_the_background_but_for_the_diamond(device):
    image = np.full((ROWS, COLS), 3.0)
    image[:, 20:] = 1.0
    measured = image.copy()
    measured[:, 15:20] = 0.0  # five pixels of shadow
    for config in (FILL, EVERYTHING):
        filtered = Rig(device, config).apply(measured)[0]
        expected = image.copy()
        expected[:, 19] = 1.0
        np.testing.assert_allclose(filtered, expected, rtol=1e-6)


def test_far_never_bleeds_into_near(device):
    image = np.full((ROWS, COLS), 3.0)
    image[6:18, 10:26] = 1.0
    for seed in range(5):
        holes = np.random.default_rng(seed).random(image.shape) < 0.2
        filtered = Rig(device, EVERYTHING).apply(np.where(holes, 0.0, image))[0]
        # A corner, or what holes leave of it, may be closed with the background.
        assert (np.abs(filtered - 1.0)[6:18, 10:26] > 1e-5).sum() <= 6
        assert np.abs(filtered - 1.0)[8:16, 12:24].max() < 1e-5
        grown = ndimage.binary_dilation(image == 1.0, iterations=2)
        np.testing.assert_allclose(filtered[~grown], 3.0, rtol=1e-6)


def test_large_holes_stay_and_read_as_far(device):
    image = np.full((ROWS, COLS), 1.0)
    image[2:22, 8:30] = 0.0
    rig = Rig(device, EVERYTHING)
    filtered = rig.apply(image)[0]
    np.testing.assert_array_equal(filtered[6:18, 12:26], 0.0)
    np.testing.assert_array_equal(rig.filter.policy.numpy()[0, 6:18, 12:26], 1.0)
    np.testing.assert_allclose(filtered[5, 11:27], 1.0)


def test_a_thin_pole_survives_and_a_stray_pixel_does_not(device):
    image = np.full((ROWS, COLS), 3.0)
    image[:, 12] = 1.0
    stray = image.copy()
    stray[10, 25] = 1.4
    stray[13, 30] = 5.0
    filtered = Rig(device, EVERYTHING).apply(stray)[0]
    # The pole's two ends at the border have one neighbour only.
    np.testing.assert_allclose(filtered[1:-1], image[1:-1], rtol=1e-6)


def test_plain_median_and_blur_against_scipy(device):
    image = np.random.default_rng(5).uniform(1.0, 1.05, (ROWS, COLS)).astype(np.float32)
    inner = (slice(1, -1), slice(1, -1))
    median = Rig(device, DepthFilterConfig(median_support=9)).apply(image)[0]
    np.testing.assert_array_equal(median[inner], ndimage.median_filter(image, 3)[inner])
    blurred = Rig(device, DepthFilterConfig(blur=0.5)).apply(image)[0]
    kernel = np.outer([0.5, 1.0, 0.5], [0.5, 1.0, 0.5]) / 4.0
    np.testing.assert_allclose(blurred[inner], ndimage.convolve(image, kernel)[inner], rtol=1e-5)
    corner = (image[:2, :2] * [[1.0, 0.5], [0.5, 0.25]]).sum() / 2.25
    assert blurred[0, 0] == pytest.approx(corner, rel=1e-5)


def test_blur_keeps_edges(device):
    image = np.full((ROWS, COLS), 3.0)
    image[:, 12:] = 1.0
    np.testing.assert_allclose(Rig(device, DepthFilterConfig(blur=1.0)).apply(image)[0], image, rtol=1e-6)


def test_memory_averages_noise(device):
    rig = Rig(device, DepthFilterConfig(memory=0.6))
    rng = np.random.default_rng(0)
    results = [rig.apply(rng.normal(2.0, 0.01, (ROWS, COLS)))[0] for _ in range(30)]
    expected = 0.01 * np.sqrt((1 - 0.6) / (1 + 0.6))  # variance of an exponential average
    assert np.std(results[15:]) == pytest.approx(expected, rel=0.05)
    assert np.mean(results[15:]) == pytest.approx(2.0, abs=1e-3)


def test_memory_converges_on_small_changes_and_forgets_on_large_ones(device):
    rig = Rig(device, DepthFilterConfig(memory=0.5, memory_change=0.05))
    rig.apply(np.full((ROWS, COLS), 2.0))
    steps = [rig.apply(np.full((ROWS, COLS), 2.08))[0, 0, 0] for _ in range(8)]
    np.testing.assert_allclose(steps, 2.08 - 0.08 * 0.5 ** np.arange(1, 9), rtol=1e-6)
    assert rig.apply(np.full((ROWS, COLS), 1.0))[0, 0, 0] == 1.0


def test_holes_hold_the_last_depth_for_some_frames(device):
    rig = Rig(device, DepthFilterConfig(hold_steps=2))
    rig.apply(plane())
    for expected in (plane(), plane(), 0.0 * plane(), 0.0 * plane()):
        np.testing.assert_array_equal(rig.apply(0.0 * plane())[0], expected)
    # The count starts anew with every measurement.
    rig.apply(plane())
    rig.apply(0.0 * plane())
    rig.apply(plane())
    rig.apply(0.0 * plane())
    np.testing.assert_array_equal(rig.apply(0.0 * plane())[0], plane())


def test_a_reset_forgets_one_world(device):
    def run(reset):
        rig = Rig(device, EVERYTHING, num_worlds=3)
        rng = np.random.default_rng(0)
        results = []
        for t in range(5):
            if t in reset:
                rig.begin([1])
            image = plane() + rng.normal(0.0, 0.01, (3, ROWS, COLS)).astype(np.float32)
            image[:, 4:, 4:] *= float(t < 3)  # a large hole, which only the past can fill
            results.append(rig.apply(image))
        return np.stack(results)

    without, with_reset = run([]), run([3])
    np.testing.assert_array_equal(with_reset[:, [0, 2]], without[:, [0, 2]])
    np.testing.assert_array_equal(with_reset[:3], without[:3])
    assert (without[3, 1] > 0.0).all()
    np.testing.assert_array_equal(with_reset[3:, 1, 10:, 10:], 0.0)


def test_graph_replay_equals_eager(device):
    eager, captured = (Rig(device, EVERYTHING, num_worlds=2) for _ in range(2))
    with wp.ScopedDevice(device), wp.ScopedCapture() as capture:
        captured.filter.update()
    for rig in (eager, captured):
        rig.begin([0, 1])
    for t in range(4):
        image = np.stack([noisy_holes(t, 0.2), plane()])
        captured.show(image)
        wp.capture_launch(capture.graph)
        np.testing.assert_array_equal(captured.filter.depth.numpy(), eager.apply(image))
        np.testing.assert_array_equal(captured.filter.policy.numpy(), eager.filter.policy.numpy())


@pytest.mark.parametrize(
    "options, key",
    [
        ({"dilate_px": -1}, "dilate_px"),
        ({"close_px": 51}, "close_px"),
        ({"fill_px": 9}, "fill_px"),
        ({"median_support": 10}, "median_support"),
        ({"hold_steps": 256}, "hold_steps"),
        ({"surface_jump": 0.0}, "surface_jump"),
        ({"memory_change": 1.0}, "memory_change"),
        ({"blur": float("nan")}, "blur"),
        ({"memory": 1.0}, "memory"),
        ({"near_m": 2.0, "far_m": 1.0}, "near_m"),
    ],
)
def test_rejects_impossible_values(options, key):
    with pytest.raises(ValueError, match=rf"depth\.filter\.{key}"):
        DepthFilterConfig(**options)


def test_rejects_flat_images():
    with pytest.raises(ValueError, match="nworld, rows, cols"):
        DepthFilter(wp.zeros((2, 10), dtype=float, device="cpu"), DepthFilterConfig())


def test_the_configuration_allows_what_the_kernel_can_fill():
    assert MAX_REACH_PX == MAX_REACH
