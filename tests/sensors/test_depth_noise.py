"""Effects of the simulated stereo camera, one by one and together."""

import math

import numpy as np
import pytest
import warp as wp

from spin_rl.sensors.depth.noise import DepthNoise, DepthNoiseConfig

ROWS, COLS = 24, 36
TAN = (0.5, 0.9)
FOCAL_PX = COLS / 1.8
EVERYTHING = DepthNoiseConfig(
    min_range_m=0.2,
    max_range_m=6.0,
    shadow_baseline_m=0.1,
    edge_dropout=0.3,
    flying_pixels=0.2,
    noise_per_m=0.01,
    noise_correlation=0.5,
    step_per_m=0.002,
    dropout=0.02,
    patches=2,
    latency_steps=(0, 2),
    mount_rotation_deg=2.0,
    mount_translation_m=0.02,
)


class Rig:
    """A camera whose exact images the test sets."""

    def __init__(self, device, config, num_worlds=1, shape=(ROWS, COLS), tan=TAN, seed=5):
        self.ideal = wp.zeros((num_worlds, *shape), dtype=float, device=device)
        seed = wp.array([seed], dtype=wp.int32, device=device)
        self.noise = DepthNoise(self.ideal, config, tan_half_fov=tan, seed=seed)
        self.begin(range(num_worlds))

    def begin(self, worlds):
        mask = np.isin(np.arange(self.ideal.shape[0]), list(worlds))
        self.noise.begin(wp.array(mask, dtype=bool, device=self.ideal.device))

    def show(self, image):
        self.ideal.assign(np.broadcast_to(np.asarray(image, dtype=np.float32), self.ideal.shape))

    def measure(self, image):
        self.show(image)
        self.noise.update()
        return self.noise.depth.numpy().copy()


def plane(depth):
    return np.full((ROWS, COLS), depth, dtype=np.float32)


def step_image():
    """A surface at 2 m, and one at 1 m in columns 12 to 23."""
    image = plane(2.0)
    image[:, 12:24] = 1.0
    return image


def random_image(seed=0):
    """Smooth slopes with blocks before them, and rays without a hit."""
    rng = np.random.default_rng(seed)
    rows, cols = np.mgrid[:ROWS, :COLS]
    image = 3.0 + 0.02 * cols - 0.03 * rows
    for _ in range(6):
        r, c = rng.integers(ROWS - 6), rng.integers(COLS - 8)
        image[r : r + 6, c : c + rng.integers(2, 8)] = rng.uniform(0.4, 2.5)
    image[:3, 30:] = 0.0
    return image.astype(np.float32)


def test_exact_when_everything_is_off(device):
    image = random_image()
    np.testing.assert_array_equal(Rig(device, DepthNoiseConfig()).measure(image)[0], image)


@pytest.mark.parametrize("depth", [0.5, 1.0, 3.0])
def test_noise_has_the_configured_sigma(device, depth):
    rig = Rig(device, DepthNoiseConfig(noise_per_m=0.004), num_worlds=20)
    errors = rig.measure(plane(depth)) - depth
    # 17280 numbers: the standard deviation is known to 0.5 %, the mean to 0.8 % of it.
    assert errors.std() == pytest.approx(0.004 * depth**2, rel=0.03)
    assert abs(errors.mean()) < 0.05 * errors.std()
    assert np.abs(errors / errors.std()).max() > 2.5


def test_noise_is_correlated_along_the_baseline_only(device):
    rig = Rig(device, DepthNoiseConfig(noise_per_m=0.01, noise_correlation=0.6), num_worlds=30)
    errors = 1.0 / rig.measure(plane(1.0)) - 1.0
    assert errors.std() == pytest.approx(0.01, rel=0.05)
    for k in (1, 2):
        correlation = np.corrcoef(errors[:, :, :-k].ravel(), errors[:, :, k:].ravel())[0, 1]
        assert correlation == pytest.approx(0.6**k, abs=0.03)
    assert abs(np.corrcoef(errors[:, :-1].ravel(), errors[:, 1:].ravel())[0, 1]) < 0.04
    # No part of the line differs from the rest.
    np.testing.assert_allclose(errors.std(axis=(0, 1)), 0.01, rtol=0.15)


def test_quantization_is_exact(device):
    step = 0.01
    image = np.random.default_rng(1).uniform(0.3, 6.0, (ROWS, COLS)).astype(np.float32)
    inverse = 1.0 / Rig(device, DepthNoiseConfig(step_per_m=step)).measure(image)[0].astype(np.float64)
    multiples = inverse / step
    np.testing.assert_allclose(multiples, np.round(multiples), atol=1e-4)
    assert np.abs(inverse - 1.0 / image).max() <= 0.5 * step + 1e-6
    assert len(np.unique(np.round(multiples))) > 50


def test_ranges_are_holes_beyond(device):
    image = plane(1.0)
    image[0, :4] = [0.29, 0.31, 3.9, 4.1]
    image[1, 0] = 0.0
    measured = Rig(device, DepthNoiseConfig(min_range_m=0.3, max_range_m=4.0)).measure(image)[0]
    expected = image.copy()
    expected[0, [0, 3]] = 0.0
    np.testing.assert_array_equal(measured, expected)


def hidden_from_right_imager(image, baseline):
    """Pixels without a partner in the right image, one by one and in pairs."""
    disparity = np.where(image > 0.0, FOCAL_PX * baseline / np.where(image > 0.0, image, 1.0), 0.0)
    columns = np.arange(COLS) - disparity
    hidden = columns < -0.5
    for u in range(COLS):
        hidden[:, u] |= (columns[:, u + 1 :] <= columns[:, u : u + 1]).any(axis=1)
    return hidden


def test_stereo_shadows_against_pairwise_rays(device):
    for seed in range(3):
        image = random_image(seed)
        measured = Rig(device, DepthNoiseConfig(shadow_baseline_m=0.1)).measure(image)[0]
        hidden = hidden_from_right_imager(image, 0.1)
        assert 0.05 < hidden.mean() < 0.5
        np.testing.assert_array_equal(measured, np.where(hidden, 0.0, image))


def test_shadow_lies_left_of_what_is_near_and_is_as_wide_as_the_disparities_differ(device):
    baseline = 6.4 / FOCAL_PX  # disparities of 6.4 pixels at 1 m and 3.2 at 2 m
    measured = Rig(device, DepthNoiseConfig(shadow_baseline_m=baseline)).measure(step_image())[0]
    np.testing.assert_array_equal(np.flatnonzero((measured == 0.0).all(0)), [0, 1, 2, 9, 10, 11])
    assert (measured[:, 12:] > 0.0).all()


def test_shadows_follow_the_wider_side_of_the_image(device):
    config = DepthNoiseConfig(shadow_baseline_m=0.1)
    image = random_image()
    upright = Rig(device, config, shape=(COLS, ROWS), tan=TAN[::-1]).measure(image.T)[0]
    np.testing.assert_array_equal(upright, Rig(device, config).measure(image)[0].T)


def test_edge_dropout_hits_both_sides_of_edges_and_nothing_else(device):
    rig = Rig(device, DepthNoiseConfig(edge_dropout=0.4), num_worlds=20)
    holes = (rig.measure(step_image()) == 0.0).mean(axis=(0, 1))
    beside = [11, 12, 23, 24]
    np.testing.assert_allclose(holes[beside], 0.4, atol=0.1)
    assert np.delete(holes, beside).max() == 0.0
    # The same edges, above one another.
    upright = Rig(device, DepthNoiseConfig(edge_dropout=0.4), shape=(COLS, ROWS), num_worlds=20)
    holes = (upright.measure(step_image().T) == 0.0).mean(axis=(0, 2))
    np.testing.assert_allclose(holes[beside], 0.4, atol=0.1)
    assert np.delete(holes, beside).max() == 0.0


def test_a_slope_is_no_edge(device):
    # A plane that falls off by more than the jump per pixel: linear in the inverse depth.
    image = np.tile(1.0 / np.linspace(0.1, 2.0, COLS), (ROWS, 1))
    assert image[0, 1] < image[0, 0] / 1.4
    config = DepthNoiseConfig(edge_dropout=0.99, edge_jump=0.1)
    assert (Rig(device, config).measure(image)[:, :, 1:] > 0.0).all()
    image[:, 20:] *= 1.3
    holes = Rig(device, config).measure(image)[0, :, 1:] == 0.0
    assert holes[:, [18, 19]].all() and holes.sum() == 2 * ROWS


def test_flying_pixels_lie_between_the_sides_of_an_edge(device):
    rig = Rig(device, DepthNoiseConfig(flying_pixels=0.5), num_worlds=20)
    measured = rig.measure(step_image())
    flying = (measured > 1.0) & (measured < 2.0)
    beside = [11, 12, 23, 24]
    np.testing.assert_allclose(flying.mean(axis=(0, 1))[beside], 0.5, atol=0.1)
    np.testing.assert_array_equal(np.where(flying, step_image(), measured)[0], step_image())
    assert np.delete(flying, beside, axis=2).sum() == 0
    assert measured[flying].std() > 0.2


def test_dropout_rate(device):
    holes = Rig(device, DepthNoiseConfig(dropout=0.05), num_worlds=20).measure(plane(1.0)) == 0.0
    assert holes.mean() == pytest.approx(0.05, abs=0.006)
    # As many in the first and last columns as elsewhere, and no runs.
    np.testing.assert_allclose(holes.mean(axis=(0, 1)), 0.05, atol=0.04)
    assert (holes[:, :, 1:] & holes[:, :, :-1]).mean() == pytest.approx(0.05**2, abs=0.002)


def test_patches_are_compact_and_move(device):
    rig = Rig(device, DepthNoiseConfig(patches=1, patch_radius_px=3.0), num_worlds=10)
    frames = [rig.measure(plane(1.0)) == 0.0 for _ in range(5)]
    sizes = []
    for holes in np.concatenate(frames):
        rows, cols = np.nonzero(holes)
        sizes.append(len(rows))
        if len(rows):
            assert np.ptp(rows) <= 6 and np.ptp(cols) <= 6
    assert 3 <= np.mean(sizes) <= 28  # ellipses with half axes of 1 to 3 pixels, some cut by the border
    assert (frames[0] != frames[1]).any(axis=(1, 2)).all()


def test_latency_counts_frames_and_a_reset_clears_one_world(device):
    rig = Rig(device, DepthNoiseConfig(latency_steps=(2, 2)), num_worlds=2)
    shown = [rig.measure(plane(float(t)))[:, 3, 3] for t in range(1, 6)]
    np.testing.assert_array_equal(np.array(shown).T, [[1, 1, 1, 2, 3]] * 2)
    rig.begin([1])
    shown = [rig.measure(plane(float(t)))[:, 3, 3] for t in range(6, 11)]
    np.testing.assert_array_equal(np.array(shown).T, [[4, 5, 6, 7, 8], [6, 6, 6, 7, 8]])


def test_latency_and_mount_are_drawn_per_episode(device):
    num_worlds = 200
    rig = Rig(device, EVERYTHING, num_worlds=num_worlds)
    latency = rig.noise.latency.numpy()
    np.testing.assert_allclose(np.bincount(latency) / num_worlds, 1 / 3, atol=0.12)
    shift, turn = rig.noise.mount_pos.numpy().copy(), rig.noise.mount_rot.numpy().astype(np.float64)
    assert 0.018 < np.abs(shift).max() <= 0.02
    assert np.abs(shift.mean(0)).max() < 0.004
    np.testing.assert_allclose(
        turn @ turn.transpose(0, 2, 1), np.broadcast_to(np.eye(3), turn.shape), atol=1e-6
    )
    axes = np.stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]], axis=1)  # small angles
    assert math.radians(1.8) < np.abs(axes).max() < math.radians(2.01)
    assert np.abs(axes.mean(0)).max() < math.radians(0.4)
    rig.begin([0])
    assert (rig.noise.mount_pos.numpy()[0] != shift[0]).all()
    np.testing.assert_array_equal(rig.noise.mount_pos.numpy()[1:], shift[1:])


def test_no_mount_error_by_default(device):
    rig = Rig(device, DepthNoiseConfig())
    np.testing.assert_array_equal(rig.noise.mount_rot.numpy()[0], np.eye(3))
    np.testing.assert_array_equal(rig.noise.mount_pos.numpy()[0], 0.0)


def test_random_numbers_depend_on_seed_world_episode_and_frame_only(device):
    def frames(num_worlds, seed=5, disturb=False):
        rig = Rig(device, EVERYTHING, num_worlds=num_worlds, seed=seed)
        result = []
        for t in range(4):
            if disturb and t == 2:
                rig.begin([1])
            result.append(rig.measure(random_image())[:])
        return np.stack(result, axis=1)

    first = frames(3)
    np.testing.assert_array_equal(frames(3), first)
    np.testing.assert_array_equal(frames(2), first[:2])
    assert (frames(3, seed=6) != first).any(axis=(1, 2, 3)).all()
    assert (first[0] != first[1]).any() and (first[0, 2] != first[0, 3]).any()
    disturbed = frames(3, disturb=True)
    np.testing.assert_array_equal(disturbed[[0, 2]], first[[0, 2]])
    assert (disturbed[1, 2:] != first[1, 2:]).any()


def test_graph_replay_equals_eager(device):
    eager = Rig(device, EVERYTHING, num_worlds=3)
    captured = Rig(device, EVERYTHING, num_worlds=3)
    captured.show(random_image(0))
    with wp.ScopedDevice(device), wp.ScopedCapture() as capture:
        captured.noise.update()
    captured.begin(range(3))
    eager.begin(range(3))
    for t in range(4):
        captured.show(random_image(t))
        wp.capture_launch(capture.graph)
        np.testing.assert_array_equal(captured.noise.depth.numpy(), eager.measure(random_image(t)))


@pytest.mark.parametrize(
    "options, key",
    [
        ({"min_range_m": -0.1}, "min_range_m"),
        ({"max_range_m": float("nan")}, "max_range_m"),
        ({"min_range_m": 1.0, "max_range_m": 0.5}, "max_range_m"),
        ({"noise_per_m": float("inf")}, "noise_per_m"),
        ({"noise_correlation": 1.0}, "noise_correlation"),
        ({"dropout": 1.5}, "dropout"),
        ({"edge_dropout": -0.1}, "edge_dropout"),
        ({"edge_jump": 0.0}, "edge_jump"),
        ({"patches": -1}, "patches"),
        ({"patch_radius_px": 0.5}, "patch_radius_px"),
        ({"latency_steps": (2, 1)}, "latency_steps"),
        ({"latency_steps": (-1, 1)}, "latency_steps"),
        ({"mount_rotation_deg": 90.0}, "mount_rotation_deg"),
        ({"mount_translation_m": -1.0}, "mount_translation_m"),
    ],
)
def test_rejects_impossible_values(options, key):
    with pytest.raises(ValueError, match=rf"depth\.noise\.{key}"):
        DepthNoiseConfig(**options)


def test_rejects_wrong_arrays():
    flat = wp.zeros((2, 10), dtype=float, device="cpu")
    seed = wp.zeros(1, dtype=wp.int32, device="cpu")
    with pytest.raises(ValueError, match="nworld, rows, cols"):
        DepthNoise(flat, DepthNoiseConfig(), tan_half_fov=TAN, seed=seed)
    with pytest.raises(ValueError, match="tan_half_fov"):
        DepthNoise(flat.reshape((2, 2, 5)), DepthNoiseConfig(), tan_half_fov=(0.0, 1.0), seed=seed)
