"""Depth images: cases with known answers, and which worlds and geoms a frame reads and writes."""

import numpy as np
import pytest
import warp as wp
from depth_oracle import KINDS, Worlds, compile_world, directions, mujoco_depth

from spin_rl.sim.graph import StepGraph

UPRIGHT = (1.0, 0.0, 0.0, 0.0)
CENTRE = (43, 28)
# The camera stands at the origin: its z axis is the world's.
SQUARE = (87, 57)
BALL = ("sphere", (0, 0, 3), UPRIGHT, (0.5,))


@pytest.fixture(params=[False, True], ids=["by_world", "by_pixel"])
def look(request, device):
    """Renders one world of solids with a pixel in the middle."""

    def render(*solids, **options):
        options = {"by_pixel": request.param, "shape": SQUARE, **options}
        return Worlds([compile_world(solids)], device, **options).render()[0]

    return render


@pytest.mark.parametrize(
    "solid, depth",
    [
        (("box", (0, 0, 3), UPRIGHT, (0.4, 0.3, 0.5)), 2.5),
        (("box", (0, 0, 3), (0, 1, 0, 0), (0.4, 0.3, 0.5)), 2.5),
        (BALL, 2.5),
        (("ellipsoid", (0, 0, 3), UPRIGHT, (0.1, 0.2, 0.5)), 2.5),
        (("cylinder", (0, 0, 3), UPRIGHT, (0.2, 0.5)), 2.5),
        (("cylinder", (0, 0, 3), (1, 1, 0, 0), (0.2, 0.5)), 2.8),
        (("capsule", (0, 0, 3), UPRIGHT, (0.2, 0.3)), 2.5),
        (("capsule", (0, 0, 3), (1, 1, 0, 0), (0.2, 0.5)), 2.8),
        (("plane", (0, 0, 3), (0, 1, 0, 0), (0, 0, 1)), 3.0),
    ],
)
def test_depth_straight_ahead(look, solid, depth):
    assert look(solid)[CENTRE] == pytest.approx(depth, abs=1e-6)


def test_depth_is_along_the_optical_axis(look):
    np.testing.assert_allclose(look(("plane", (0, 0, 3), (0, 1, 0, 0), (0, 0, 1))), 3.0, rtol=1e-6)


@pytest.mark.parametrize(
    "solid",
    [
        ("plane", (0, 0, 3), UPRIGHT, (0, 0, 1)),  # from behind
        ("sphere", (0, 0, -3), UPRIGHT, (0.5,)),  # behind the camera
        ("box", (0, 0, -50), UPRIGHT, (0.1, 0.1, 0.1)),  # parked
        ("box", (0, 0, 50), UPRIGHT, (0.1, 0.1, 0.1)),
        ("sphere", (0, 0, 11.0), UPRIGHT, (0.9,)),  # beyond the largest range
        ("plane", (0, 0, 10.5), (0, 1, 0, 0), (0, 0, 1)),
        ("sphere", (3.5, 0, 3), UPRIGHT, (0.5,)),  # beside the image
        ("box", (0, 2.5, 3), UPRIGHT, (0.5, 0.5, 0.5)),
    ],
)
def test_nothing_to_see(look, solid):
    assert not look(solid).any()


@pytest.mark.parametrize(
    "solid, at",
    [
        (("box", (1.5, 0, 3), UPRIGHT, (0.1, 0.1, 0.1)), (1, 0)),  # optical x points down in the image
        (("box", (-1.5, 0, 3), UPRIGHT, (0.1, 0.1, 0.1)), (-1, 0)),
        (("box", (0, 0.8, 3), UPRIGHT, (0.1, 0.1, 0.1)), (0, -1)),  # optical y points to the left
        (("box", (0, -0.8, 3), UPRIGHT, (0.1, 0.1, 0.1)), (0, 1)),
    ],
)
def test_image_is_upright(look, solid, at):
    pixels = np.argwhere(look(solid) > 0.0).mean(0) - CENTRE
    assert np.array_equal(np.sign(np.round(pixels / 5.0)), at)


def test_the_nearest_wins(look):
    far = ("box", (0, 0, 5), UPRIGHT, (5, 5, 0.1))
    image = look(far, BALL, ("sphere", (0, 0, 2), UPRIGHT, (0.1,)))
    assert image[CENTRE] == pytest.approx(1.9, abs=1e-6)
    assert image.max() == pytest.approx(4.9, abs=1e-5) and image.min() > 1.8


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "plane"])
def test_inside_a_solid_the_camera_sees_its_far_side(look, kind):
    image = look((kind, (0, 0, 0), UPRIGHT, (0.4, 0.3, 0.5)))
    assert image.min() > 0.0
    far = {"sphere": 0.4, "cylinder": 0.3, "capsule": 0.7}.get(kind, 0.5)
    assert image[CENTRE] == pytest.approx(far, abs=1e-6)


@pytest.mark.parametrize("gap", [0.0, 1e-6, -1e-6, 1e-4])
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "plane"])
def test_on_a_surface(look, kind, gap):
    """A camera that grazes a solid, or touches it, sees something finite."""
    solid = (kind, (0.5 + gap, 0, 0.3), UPRIGHT, (0.5, 0.5, 0.5))
    image = look(solid)
    assert np.isfinite(image).all() and image.min() >= 0.0
    if gap == 1e-4:
        m, d = compile_world([solid])
        # Half a row off the surface the depth is as in MuJoCo; nearer, float32 cannot tell.
        expected = mujoco_depth(m, d, 0, shape=SQUARE)
        np.testing.assert_allclose(image[46:], expected[46:], rtol=1e-2)


def test_pixels_look_through_their_centres(look):
    """The edge of a wall that covers one half: the middle column is hit if the wall passes its centre."""
    pitch = 2.0 * 0.55 / 57
    for edge, columns in ((0.4 * pitch, 28), (-0.4 * pitch, 28), (0.6 * pitch, 27), (-0.6 * pitch, 29)):
        image = look(("box", (0, 5.0 + edge, 1.0), UPRIGHT, (9, 5, 1e-4)))
        hit = (directions(shape=SQUARE)[0, :, 1] > edge).sum()
        assert hit in (columns, columns + 1) and (image[43] > 0.0).sum() == hit


def test_unseen_worlds_are_left_alone(device):
    worlds = Worlds([compile_world([BALL]), compile_world([BALL])], device)
    worlds.camera.depth.fill_(7.0)
    mask = wp.array([False, True], dtype=bool, device=device)
    image = worlds.render(mask)
    np.testing.assert_array_equal(image[0], 7.0)
    assert image[1, 43, 28] == pytest.approx(2.5, abs=1e-2)
    image = worlds.render()
    np.testing.assert_array_equal(image[0], image[1])


def test_worlds_do_not_mix(device):
    """Sizes, poses and cameras are those of the world itself."""
    scenes = [
        ([BALL, ("box", (0, 1, 4), UPRIGHT, (0.2, 0.2, 0.2))], (0, 0, 0)),
        (
            [("sphere", (1, 0, 2), UPRIGHT, (0.2,)), ("box", (0, -1, 3), UPRIGHT, (0.5, 0.1, 0.2))],
            (0.3, 0, 1),
        ),
        (
            [("sphere", (0, 0, -50), UPRIGHT, (0.2,)), ("box", (0, 0, 3), UPRIGHT, (0.1, 0.1, 0.1))],
            (0, 0, -1),
        ),
    ]
    worlds = [compile_world(*scene) for scene in scenes]
    together = Worlds(worlds, device).render()
    for world, image in zip(worlds, together, strict=True):
        np.testing.assert_array_equal(Worlds([world], device).render()[0], image)
        assert (image > 0.0).any()


def test_one_size_for_all_worlds(device):
    """A model without per-world sizes has one row of them."""
    worlds = Worlds([compile_world([BALL])] * 2, device)
    both = worlds.render()
    worlds.model.geom_size = worlds.model.geom_size[:1]
    np.testing.assert_array_equal(worlds.render(), both)


@pytest.mark.parametrize("by_pixel", [False, True])
def test_graph_follows_what_moves(device, by_pixel):
    """Replayed, with another pose, size, camera and mask than those captured, as eager launches do."""
    near, far = (
        compile_world([BALL]),
        compile_world([("sphere", (0.2, 0.1, 4), UPRIGHT, (0.8,))], (0, 0, 0.5)),
    )
    worlds = Worlds([near, near], device, by_pixel=by_pixel)
    mask = wp.full(2, True, dtype=bool, device=device)
    worlds.render(mask)
    graph = StepGraph(lambda: worlds.camera.update(mask), device)
    before = worlds.render(mask)
    moved = Worlds([far, far], device, by_pixel=by_pixel)
    eager = moved.render()
    for name in ("geom_xpos", "geom_xmat", "site_xpos", "site_xmat"):
        getattr(worlds.data, name).assign(getattr(moved.data, name))
    worlds.model.geom_size.assign(moved.model.geom_size)
    mask.assign(np.array([False, True]))
    graph.replay()
    after = worlds.camera.depth.numpy()
    np.testing.assert_array_equal(after[0], before[0])
    np.testing.assert_array_equal(after[1], eager[1])
    assert (after[0] != after[1]).any()


def test_a_world_gone_wrong_harms_no_other(device):
    worlds = Worlds([compile_world([BALL, BALL])] * 2, device)
    expected = worlds.render()[1]
    poses = worlds.data.geom_xpos.numpy()
    poses[0] = np.nan
    worlds.data.geom_xpos.assign(poses)
    np.testing.assert_array_equal(worlds.render()[1], expected)


def test_zero_sizes_are_invisible_or_finite(look):
    for kind in ("sphere", "ellipsoid", "cylinder", "capsule", "box"):
        solid = (kind, (0, 0, 3), UPRIGHT, (1e-7, 1e-7, 1e-7))
        image = look(solid, ("plane", (0, 0, 4), (0, 1, 0, 0), (0, 0, 1)))
        assert ((image > 2.9) & (image < 4.001)).all()
