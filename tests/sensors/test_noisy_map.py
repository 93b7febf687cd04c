"""Errors of maps against the table of Miki et al. 2022, by NumPy's and SciPy's formulas."""

import numpy as np
import pytest
import warp as wp
from scipy import stats

from spin_rl.sensors.noisy_map import ERRORS, NoisyMap

# z0 to z7 of the table, its last entry for both offsets; the multiples of c at c = 0.5.
TABLE = {
    "none": (0, 0, 0, 0, 0, 0, 0, 0),
    "nominal": (0.004, 0.005, 0.01, 0.04, 0.03, 0.05, 0.1, 0.1),
    "offset": (0.004, 0.005, 0.01, 0.05, 0.05, 0.02, 0.1, 0.1),
    "noisy": (0.004, 0.05, 0.05, 0.15, 0.15, 0.15, 0.1, 0.1),
    "small": (0.004, 0.005, 0.04, 0.04, 0.04, 0.01, 0.1, 0.1),
    "large": (0.004, 0.3, 0.2, 0.1, 0.1, 0.03, 0.1, 0.1),
}
WORLDS, TOKENS = 400, 12


class Worlds:
    """A map over arrays that a test writes: `TOKENS` tokens a world, the last of which nobody knows."""

    def __init__(self, errors, device, level=0.5):
        generator = np.random.default_rng(1)
        tokens = np.zeros((WORLDS, TOKENS, 32), dtype=np.float32)
        tokens[..., :24] = generator.uniform(-2.0, 2.0, (WORLDS, TOKENS, 24))
        tokens[..., 24:] = 1.0
        tokens[:, -1] = 0.0
        tokens[:, 0, 24] = 0.0  # one corner of the first
        tokens[:, 0, :3] = 0.0
        self.exact = tokens
        self.arrays = {
            "seed": np.array([7], dtype=np.int32),
            "episode": np.ones(WORLDS, dtype=np.int32),
            "step": np.zeros(WORLDS, dtype=np.int32),
            "level": np.full(WORLDS, level, dtype=np.float32),
            "way": np.full(WORLDS, 5.0, dtype=np.float32),
            "way_left": np.full(WORLDS, 5.0, dtype=np.float32),
            "qpos": np.zeros((WORLDS, 3), dtype=np.float32),
        }
        self._device = {name: wp.array(values, device=device) for name, values in self.arrays.items()}
        self._map = NoisyMap(wp.array(tokens, device=device), errors, **self._device)

    def read(self, **changes):
        """Errors of the corners that are known and the flags, after changes of the arrays."""
        for name, values in changes.items():
            self.arrays[name][...] = values
            self._device[name].assign(self.arrays[name])
        self._map.update()
        tokens = self._map.tokens.numpy()
        return (tokens - self.exact)[..., :24].reshape(WORLDS, TOKENS, 8, 3), tokens[..., 24:]


def known(errors):
    """Those of the tokens of which all corners are known, shape (worlds, corners, 3)."""
    return errors[:, 1:-1].reshape(WORLDS, -1, 3)


def test_only_known_corners_move(device):
    worlds = Worlds("large", device)
    errors, flags = worlds.read()
    np.testing.assert_array_equal(flags, worlds.exact[..., 24:])
    assert (errors[:, -1] == 0).all() and (errors[:, 0, 0] == 0).all()
    assert (errors[:, 0, 1:] != 0).all() and (known(errors) != 0).all()


def test_an_exact_map_is_that_of_the_scandots(device):
    errors, _ = Worlds("none", device).read()
    assert (errors == 0).all()


def parts_of(errors, steps):
    """Medians over the corners, which outliers do not move, and what is left, in several steps."""
    readings = []
    for step in range(steps):
        readings.append(known(errors.read(step=step)[0]))
    readings = np.stack(readings)
    shift = np.median(readings, axis=2)
    return shift, readings - shift[:, :, None]


@pytest.mark.parametrize("name", [name for name in TABLE if name != "none"])
def test_sizes_are_those_of_the_table(device, name):
    point_xy, point_z, frame_xy, frame_z, outlier, share, offset_xy, offset_z = TABLE[name]
    shift, points = parts_of(Worlds(name, device), steps=12)
    # Of all points of a world together: the offset stays in all steps, the frame's error is new in each.
    over_steps = shift.var(axis=0, ddof=1).mean(axis=0)
    between = shift.mean(axis=0).var(axis=0) - over_steps / len(shift)
    tolerance = {"rel": 0.12, "abs": 0.003}
    assert np.sqrt(over_steps[:2]) == pytest.approx([frame_xy] * 2, **tolerance)
    assert np.sqrt(over_steps[2]) == pytest.approx(frame_z, **tolerance)
    assert np.sqrt(between) == pytest.approx([offset_xy, offset_xy, offset_z], **tolerance)
    # Of a point: a mixture of two normal distributions, whose variances add up.
    mixed = [np.sqrt(size**2 + share * outlier**2) for size in (point_xy, point_xy, point_z)]
    assert points.std(axis=(0, 1, 2)) == pytest.approx(mixed, rel=0.05)
    normal = stats.norm(scale=[point_xy, np.hypot(point_xy, outlier)])
    expected = np.dot([1 - share, share], normal.sf(0.02) * 2)
    assert (np.abs(points[..., 0]) > 0.02).mean() == pytest.approx(expected, rel=0.1)


def test_an_outlier_moves_in_all_directions_at_once(device):
    points = parts_of(Worlds("nominal", device), steps=4)[1]
    far = np.abs(points) > 0.02
    share = far[..., 0].mean()
    assert far[..., 1][far[..., 0]].mean() > 10 * share  # alone, by chance, it would be as many as anywhere


def test_an_offset_stays_where_it_is_in_the_world(device):
    """As the robot turns, the errors turn against it; a new episode has others, neighbours keep theirs."""
    worlds = Worlds("nominal", device)
    before = np.median(known(worlds.read()[0]), axis=1)
    yaw = 1.1
    worlds.arrays["qpos"][:, 2] = yaw
    turned = np.median(known(worlds.read(qpos=worlds.arrays["qpos"])[0]), axis=1)
    rotation = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    frame = TABLE["nominal"][2]  # the same draw, but in the frame that turned
    np.testing.assert_allclose(turned[:, :2], before[:, :2] @ rotation.T, atol=6 * frame)
    correlation = np.corrcoef(turned[:, 0], (before[:, :2] @ rotation.T)[:, 0])[0, 1]
    assert correlation > 0.95
    worlds.arrays["episode"][:200] += 1
    anew = np.median(known(worlds.read(episode=worlds.arrays["episode"])[0]), axis=1)
    np.testing.assert_array_equal(anew[200:], turned[200:])
    assert abs(np.corrcoef(anew[:200, 0], turned[:200, 0])[0, 1]) < 0.25


def kinds_of(errors, steps=8):
    """How far the points of every world scatter in z: .005 and outliers, likewise, or far more."""
    points = parts_of(errors, steps)[1][..., 2]
    return np.percentile(np.abs(points), 50, axis=(0, 2)) > 0.015


def test_kinds_are_drawn_by_their_shares_in_both_halves_of_the_way(device):
    worlds = Worlds("mixture", device)
    first = kinds_of(worlds)
    worlds.read(way_left=2.6)
    assert (kinds_of(worlds) == first).all()
    worlds.read(way_left=2.4)
    second = kinds_of(worlds)
    # A tenth is noisy in either half, and the halves do not depend on each other.
    for noisy in (first, second):
        assert stats.binomtest(int(noisy.sum()), WORLDS, 0.1).pvalue > 0.001
    both = [
        [(first & second).sum(), (first & ~second).sum()],
        [(~first & second).sum(), (~first & ~second).sum()],
    ]
    assert (first != second).any() and stats.fisher_exact(both).pvalue > 0.001


def test_errors_of_c_grow_with_the_level(device):
    for level, z_error in ((0.0, 0.0), (1.0, 0.1)):
        points = parts_of(Worlds("noisy", device, level=level), steps=6)[1][..., 2]
        share = ERRORS["noisy"].rising[5] * level
        mixed = np.sqrt(z_error**2 + share * (0.3 * level) ** 2)
        assert points.std() == pytest.approx(mixed, rel=0.05, abs=1e-6)
