"""Which pixels show a target: against the geoms that C MuJoCo's rays hit, and cases with known answers."""

import numpy as np
import pytest
import warp as wp
from depth_oracle import KINDS, Worlds, compile_world, directions, mujoco_hits, random_world

from spin_rl.detection.segmentation import SegmentationDetector
from spin_rl.sim.graph import StepGraph

UPRIGHT = (1.0, 0.0, 0.0, 0.0)
SQUARE = (87, 57)
CENTRE = (43, 28)
BALL = ("sphere", (0, 0, 2), UPRIGHT, (0.2,))
SCREEN = ("box", (0, 0, 1), UPRIGHT, (0.02, 0.5, 0.01))
WALL = ("box", (0, 0, 4), UPRIGHT, (5, 5, 0.1))
OUTPUTS = ("visible", "num_pixels", "pixel", "box", "depth", "point_b")


def detector_of(worlds, geoms, **options) -> SegmentationDetector:
    """A detector of some geoms of each world."""
    options = {"base_body": 0, "geoms": geoms[0], **options}
    detector = SegmentationDetector(worlds.camera, worlds.data, **options)
    detector.geoms.assign(np.array(geoms, dtype=np.int32))
    return detector


def results(detector) -> dict[str, np.ndarray]:
    return {name: getattr(detector, name).numpy().copy() for name in OUTPUTS}


def look(device, solids, geoms, **options) -> dict[str, np.ndarray]:
    """What is found of one world's geoms, the camera at the origin looking along z."""
    worlds = Worlds([compile_world(solids)], device, shape=SQUARE)
    worlds.render()
    detector = detector_of(worlds, [geoms], **options)
    detector.update()
    return {name: value[0] for name, value in results(detector).items()}


@pytest.mark.parametrize("by_pixel", [False, True])
def test_as_c_mujocos_rays_hit(device, by_pixel):
    """Five geoms each of random worlds, partly hidden and of any kind, some out of view."""
    rng = np.random.default_rng(7)
    kinds = [kind for kind in KINDS if kind != "plane"]
    natives = [random_world(rng, kinds * 4) for _ in range(50)]
    worlds = Worlds(natives, device, by_pixel=by_pixel)
    worlds.render()
    geoms = rng.permuted(np.tile(np.arange(20), (len(natives), 1)), axis=1)[:, :5]
    detector = detector_of(worlds, geoms)
    detector.update()
    found = results(detector)
    seen = 0
    for world, (m, d) in enumerate(natives):
        hits, depth = mujoco_hits(m, d, 0)
        shown = np.isin(hits, geoms[world])
        moved = [
            mujoco_hits(m, d, 0, shift=shift)[0] for shift in ((1e-4, 0), (-1e-4, 0), (0, 1e-4), (0, -1e-4))
        ]
        unsure = sum(np.any([np.isin(other, geoms[world]) != shown for other in moved], axis=0).ravel())
        count = shown.sum()
        assert abs(found["num_pixels"][world] - count) <= unsure
        if unsure > 0.1 * count:
            continue
        seen += 1 if count else 0
        assert found["visible"][world] == (count > 0)
        if count == 0:
            assert not any(found[name][world].any() for name in OUTPUTS)
            continue
        at = np.argwhere(shown)
        slack = 2.0 * unsure * max(SQUARE) / count
        np.testing.assert_allclose(found["pixel"][world], at.mean(0), atol=1e-3 + slack)
        median = np.sort(depth[shown])[
            [max((count - 1) // 2 - unsure, 0), min((count - 1) // 2 + unsure, count - 1)]
        ]
        assert median[0] - 1e-4 <= found["depth"][world] <= median[1] + 1e-4
        if unsure == 0:
            box = [at[:, 0].min(), at[:, 0].max() + 1, at[:, 1].min(), at[:, 1].max() + 1]
            np.testing.assert_array_equal(found["box"][world], box)
    assert seen >= 12


def test_point_of_a_ball_ahead(device):
    """The mean pixel's ray at the median depth, from NumPy; the offset leads to the centre."""
    found = look(device, [BALL, WALL], [0])
    m, d = compile_world([BALL, WALL])
    hits, depth = mujoco_hits(m, d, 0, shape=SQUARE)
    np.testing.assert_allclose(found["pixel"], CENTRE, atol=1e-5)
    assert found["visible"] and found["num_pixels"] == (hits == 0).sum() > 50
    middle = np.sort(depth[hits == 0])[((hits == 0).sum() - 1) // 2]
    np.testing.assert_allclose(found["point_b"], [0, 0, middle], atol=1e-5)
    # Half of a disc's area is within 1 / sqrt(2) of its radius, where a ball's surface is as much nearer.
    assert 2.0 - found["depth"] == pytest.approx(0.2 / np.sqrt(2), abs=0.01)


def test_point_in_the_frame_of_the_base(device):
    """Camera and base anywhere: the pixel's ray in the world, seen from the base."""
    m, d = compile_world(
        [("sphere", (1.0, -0.6, -0.4), UPRIGHT, (0.1,))], (0.1, 0.4, 0.2), (0.6, 0.3, 0.7, -0.2)
    )
    worlds = Worlds([(m, d)], device)
    at, frame = np.array([0.3, -0.5, 0.1]), np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]])
    worlds.data.xpos.assign(at[None, None].astype(np.float32))
    worlds.data.xmat.assign(frame[None, None].astype(np.float32))
    worlds.render()
    detector = detector_of(worlds, [[0]])
    offset = 0.03
    detector.centre_offset.fill_(offset)
    detector.update()
    hits, depth = mujoco_hits(m, d, 0)
    shown = np.argwhere(hits == 0)
    assert 0 < len(shown) == detector.num_pixels.numpy()[0]
    pixel = shown.mean(0)
    x = 0.9 * (2 * (pixel[0] + 0.5) / 87 - 1)
    y = -0.55 * (2 * (pixel[1] + 0.5) / 58 - 1)
    ray = np.array([x, y, 1.0])
    z = np.sort(depth[hits == 0])[(len(shown) - 1) // 2]
    sight = z * ray + offset * ray / np.linalg.norm(ray)
    world = d.site_xpos[0] + d.site_xmat[0].reshape(3, 3) @ sight
    np.testing.assert_allclose(detector.point_b.numpy()[0], frame.T @ (world - at), atol=1e-4)


def test_what_hides_the_target_is_not_of_it(device):
    """A bar across its middle leaves the pixels above and below."""
    free = look(device, [BALL, WALL], [0])
    hidden = look(device, [BALL, WALL, SCREEN], [0])
    assert 0 < hidden["num_pixels"] < free["num_pixels"]
    np.testing.assert_array_equal(hidden["box"], free["box"])
    bar = look(device, [BALL, WALL, SCREEN], [2])
    assert bar["depth"] == pytest.approx(0.99, abs=1e-5)


def test_geoms_of_a_target_count_once(device):
    """A ball in a ball of the same size, and one inside: the pixels are those of the ball."""
    inner = ("sphere", (0, 0, 2), UPRIGHT, (0.1,))
    one = look(device, [BALL, BALL, inner], [0, -1, -1])
    assert all(
        np.array_equal(one[name], value)
        for name, value in look(device, [BALL, BALL, inner], [0, 1, 2]).items()
    )


@pytest.mark.parametrize(
    "solids, geoms",
    [
        ([BALL, WALL], [-1]),
        ([WALL, ("sphere", (0, 0, 6), UPRIGHT, (0.2,))], [1]),  # behind the wall
        ([BALL, ("sphere", (0, 0, -2), UPRIGHT, (0.2,))], [1]),  # behind the camera
        ([("sphere", (0, 0, 12), UPRIGHT, (0.2,)), WALL], [0]),  # out of range
    ],
)
def test_nothing_to_see(device, solids, geoms):
    assert not any(value.any() for value in look(device, solids, geoms).values())


def test_too_few_pixels(device):
    count = look(device, [BALL], [0])["num_pixels"]
    enough = look(device, [BALL], [0], min_pixels=int(count))
    assert enough["visible"] and enough["point_b"].any()
    few = look(device, [BALL], [0], min_pixels=int(count) + 1)
    assert not few["visible"] and not few["point_b"].any() and few["num_pixels"] == count


def test_depth_is_the_median_of_what_was_measured(device):
    """Holes do not count, and a few wild values have no weight; of two middle ones the nearer."""
    worlds = Worlds([compile_world([BALL, WALL])] * 5, device, shape=SQUARE)
    exact = worlds.render()
    shown = np.isclose(mujoco_hits(*worlds.native[0], 0, shape=SQUARE)[0], 0)
    rng = np.random.default_rng(0)
    measured = exact + rng.normal(0.0, 0.01, exact.shape)
    measured[1, shown] = np.where(rng.random(shown.sum()) < 0.4, 0.0, measured[1, shown])
    measured[2, shown] = np.where(rng.random(shown.sum()) < 0.3, 3.9, measured[2, shown])
    measured[3] = 0.0
    measured[4, shown] = np.nan
    measured = measured.astype(np.float32)
    detector = detector_of(worlds, [[0]] * 5, measured=wp.array(measured, dtype=float, device=device))
    detector.update()
    found = results(detector)
    for world in range(3):
        values = measured[world, shown]
        values = np.sort(values[values > 0.0])
        assert found["depth"][world] == values[(len(values) - 1) // 2]
    np.testing.assert_array_equal(found["visible"], [True, True, True, False, False])
    np.testing.assert_array_equal(found["num_pixels"], shown.sum())
    assert not found["point_b"][3:].any()


def test_worlds_are_looked_at_one_by_one(device):
    """Each has its own target; what is masked keeps what was known of it."""
    solids = [BALL, ("sphere", (0.4, 0.3, 1.5), UPRIGHT, (0.1,))]
    worlds = Worlds([compile_world(solids)] * 2, device)
    worlds.render()
    detector = detector_of(worlds, [[0], [1]])
    detector.update()
    before = results(detector)
    assert before["pixel"][0][0] < before["pixel"][1][0] and before["visible"].all()
    detector.geoms.assign(np.array([[1], [0]], dtype=np.int32))
    detector.update(wp.array([False, True], dtype=bool, device=device))
    after = results(detector)
    for name in OUTPUTS:
        np.testing.assert_array_equal(after[name], [before[name][0]] * 2)


def test_graph_follows_target_and_poses(device):
    near = compile_world([BALL, WALL, SCREEN])
    worlds = Worlds([near, near], device)

    def launch():
        worlds.camera.update()
        detector.update()

    worlds.render()
    detector = detector_of(worlds, [[0], [0]])
    launch()
    graph = StepGraph(launch, device)
    detector.geoms.assign(np.array([[0], [2]], dtype=np.int32))
    poses = worlds.data.geom_xpos.numpy()
    poses[0, 0] += [0.1, 0.2, 0.3]
    worlds.data.geom_xpos.assign(poses)
    graph.replay()
    replayed = results(detector)
    launch()
    for name, value in results(detector).items():
        np.testing.assert_array_equal(replayed[name], value)
    assert replayed["visible"].all() and replayed["point_b"][0, 1] > 0.15


def test_depth_images_do_not_change(device):
    worlds = Worlds([compile_world([BALL, WALL])], device)
    before = worlds.render()
    detector_of(worlds, [[0]]).update()
    np.testing.assert_array_equal(worlds.camera.depth.numpy(), before)


@pytest.mark.parametrize(
    "options, message",
    [
        ({"geoms": []}, "geoms"),
        ({"geoms": [0, 1]}, "geoms"),
        ({"min_pixels": 0}, "min_pixels"),
        ({"base_body": 1}, "base_body"),
        ({"measured": wp.zeros((1, 5, 5), dtype=float, device="cpu")}, "measured"),
    ],
)
def test_rejects(device, options, message):
    worlds = Worlds([compile_world([BALL])], device)
    with pytest.raises(ValueError, match=message):
        SegmentationDetector(worlds.camera, worlds.data, **{"base_body": 0, "geoms": [0], **options})


def test_directions_of_the_oracle():
    """The centre pixel of an odd image looks along z: the cases above rely on it."""
    np.testing.assert_allclose(directions(shape=SQUARE)[CENTRE], [0, 0, 1], atol=1e-12)
