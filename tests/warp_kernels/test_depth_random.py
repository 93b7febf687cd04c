"""Depth images of random scenes, against C MuJoCo's rays."""

import numpy as np
import pytest
from depth_oracle import Worlds, clear_cut, compile_world, mujoco_depth, random_quat, random_world

TOLERANCE_M = 1e-4
SOLIDS = ("box", "sphere", "capsule", "ellipsoid", "cylinder")


def check(worlds: Worlds, least_sure=0.9) -> np.ndarray:
    """Compare all worlds with the oracle; return its depths where both are certain."""
    images = worlds.render()
    assert np.isfinite(images).all()
    depths, sure = [], []
    for image, (m, d) in zip(images, worlds.native, strict=True):
        depth, clear = mujoco_depth(m, d, 0), clear_cut(m, d, 0)
        np.testing.assert_allclose(image[clear], depth[clear], rtol=0.0, atol=TOLERANCE_M)
        depths.append(depth[clear])
        sure.append(clear.mean())
    assert np.mean(sure) > least_sure
    return np.concatenate(depths)


@pytest.mark.parametrize("by_pixel", [False, True])
def test_all_kinds_together(device, by_pixel):
    rng = np.random.default_rng(0)
    worlds = [random_world(rng, SOLIDS * 5) for _ in range(12)]
    depths = check(Worlds(worlds, device, by_pixel=by_pixel))
    assert 0.2 < (depths > 0.0).mean() < 0.98


@pytest.mark.parametrize("by_pixel", [False, True])
@pytest.mark.parametrize("kind", SOLIDS)
def test_near_and_from_inside(device, kind, by_pixel):
    """One solid, and a camera that is as likely inside as outside."""
    rng = np.random.default_rng(1)
    size = (0.5, 0.8, 0.6)
    worlds = [
        compile_world(
            [(kind, (0, 0, 0), random_quat(rng), size)], rng.uniform(-0.9, 0.9, 3), random_quat(rng)
        )
        for _ in range(16)
    ]
    depths = check(Worlds(worlds, device, by_pixel=by_pixel), least_sure=0.8)
    assert (depths > 0.0).any()


@pytest.mark.parametrize("by_pixel", [False, True])
def test_hundreds_of_solids(device, by_pixel):
    rng = np.random.default_rng(2)
    check(Worlds([random_world(rng, SOLIDS * 60)], device, by_pixel=by_pixel), least_sure=0.5)


def test_rectangles_of_planes(device):
    rng = np.random.default_rng(3)
    for size in ((0.5, 0.8, 1.0), (0.0, 0.4, 1.0), (0.7, 0.0, 1.0)):
        plane = ("plane", (0, 0, 0), random_quat(rng), size)
        poses = [(rng.uniform(-2, 2, 3), random_quat(rng)) for _ in range(12)]
        depths = check(Worlds([compile_world([plane], *pose) for pose in poses], device))
        assert (depths > 0.0).any()


@pytest.mark.parametrize("shape", [(20, 16), (7, 5), (58, 87), (3, 33)])
def test_resolutions(device, shape):
    """Any number of columns, also one that is no multiple of those drawn together, or less."""
    world = random_world(np.random.default_rng(4), SOLIDS * 5)
    image = Worlds([world], device, shape=shape).render()[0]
    clear = clear_cut(*world, 0, shape=shape)
    assert image.shape == shape and (image > 0.0).any()
    np.testing.assert_allclose(
        image[clear], mujoco_depth(*world, 0, shape=shape)[clear], rtol=0.0, atol=TOLERANCE_M
    )


def test_order_of_the_solids_does_not_matter(device):
    rng = np.random.default_rng(5)
    solids = [(kind, rng.uniform(-2, 2, 3), random_quat(rng), (0.3, 0.3, 0.3)) for kind in SOLIDS * 4]
    images = [Worlds([compile_world(some)], device).render() for some in (solids, solids[::-1])]
    np.testing.assert_array_equal(*images)
