"""The crossings of scene=blind_crossing: what they promise, and that there is a way."""

import numpy as np
import pytest
from room_worlds import generate

from spin_rl.planning import solvability

PARAMS = solvability.scene_params("blind_crossing")


@pytest.fixture(scope="module")
def scenes(device):
    return generate(100, device, PARAMS, seed=2).scenes()


def test_everything_waits_out_of_sight_for_the_robot(scenes):
    floating, sides = [], []
    for scene in scenes:
        assert 2.0 * scene.half_size[scene.is_wall & scene.active, 2].min() >= 1.6 - 1e-5
        movers = np.flatnonzero(scene.active & ~scene.is_wall)
        assert 4 <= len(movers) == (scene.motion_speed[movers] > 0.0).sum() <= 8
        assert (scene.motion_trigger[movers] >= 0.65).all() and (scene.motion_trigger[movers] <= 1.0).all()
        assert (np.hypot(*(scene.home[movers, :2] - scene.start[:2]).T) > 0.5).all()
        floating += list(scene.pos[movers, 2] - scene.half_size[movers, 2] > 1.0)
        sides += list(np.sign(scene.retreat[movers, 1]))
    assert np.mean(floating) == pytest.approx(PARAMS.crossing.floating_share, abs=0.1)
    assert abs(np.mean(sides)) < 0.2


@pytest.mark.slow
def test_the_planner_finds_a_way(scenes):
    """With everything out; 1000: python -m spin_rl.planning.solvability --scene blind_crossing."""
    assert np.mean([solvability.is_solvable(scene) for scene in scenes]) >= 0.995
