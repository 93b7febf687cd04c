"""Scenes without what hangs or lies flat."""

import numpy as np

from spin_rl.scenes.grounded import grounded
from spin_rl.scenes.scene_file import parse_scene


def test_everything_within_reach_crosses_the_plane_of_the_lidar():
    scene = parse_scene(
        {
            "start": {"position": [0, 0]},
            "goal": [3, 0],
            "boxes": [
                {"position": [1, 1, 1.2], "size": [0.4, 0.4, 0.2]},  # hangs at the height of the head
                {"position": [1, -1], "size": [0.4, 0.4, 0.06]},  # lies flat
                {"position": [2, 1, 2.0], "size": [0.4, 0.4, 0.2]},  # above the robot
                {"position": [2, -1], "size": [0.4, 0.4, 0.9]},  # stands
            ],
            "cylinders": [
                {"position": [3, 1, 1.0], "radius": 0.1, "height": 0.4, "motion": {"to": [3, 2], "speed": 1}}
            ],
        }
    )
    changed = grounded(scene, 1.45)
    bottom, top = (changed.pos[:, 2] + sign * changed.half_size[:, 2] for sign in (-1, 1))
    np.testing.assert_allclose(bottom, (0, 0, 1.9, 0, 0), atol=1e-9)
    np.testing.assert_allclose(top, (1.3, 0.3, 2.1, 0.9, 1.2))
    assert changed.home[4, 2] == changed.pos[4, 2] == 0.6
    np.testing.assert_array_equal(changed.pos[:, :2], scene.pos[:, :2])
    assert scene.pos[0, 2] == 1.2  # the given one is as it was
