"""When the camera sees the object: a table of places before a level camera and one small box."""

import numpy as np
import pytest
import warp as wp

from spin_rl.scenes.layout import Layout, PoolSpec, Scene
from spin_rl.sensors.object_sight import ObjectSight

CAMERA = (0.0, 0.0, 1.0)
# Columns: right, down and forward of a camera that looks along +x.
LEVEL = [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
POOL = PoolSpec(num_walls=0, num_boxes=1, num_cylinders=0)
TAN, NEAR, FAR = (0.5, 0.25), 0.2, 4.0
FIRST = 3
# Position of the object, whether it is seen, and whether it would be without the box at x = 1.5 m.
CASES = [
    ((1.0, 0.0, 1.0), True, True),
    ((0.21, 0.0, 1.0), True, True),
    ((0.19, 0.0, 1.0), False, False),
    ((-1.0, 0.0, 1.0), False, False),
    ((3.95, 1.0, 1.0), True, True),  # farther away than 4 m, but not as deep
    ((4.05, 1.0, 1.0), False, False),
    ((9.0, -1.0, 1.0), False, False),
    ((2.0, 0.98, 1.0), True, True),
    ((2.0, -1.02, 1.0), False, False),
    ((2.0, -0.5, 1.48), True, True),
    ((2.0, -0.5, 0.48), False, False),
    ((3.0, 0.0, 1.0), False, True),
    ((3.0, 0.0, 1.3), True, True),
]


@pytest.mark.parametrize("occlusion", [True, False])
def test_what_is_in_the_image_in_range_and_not_hidden_is_seen(device, occlusion):
    n = len(CASES)
    scene = Scene.empty(POOL)
    scene.pos[0], scene.half_size[0], scene.active[0] = (1.5, 0.0, 1.0), 0.1, True
    layout = Layout(n, POOL, device)
    layout.load(scene)
    qpos = np.zeros((n, FIRST + 3), np.float32)
    qpos[:, FIRST:] = [at for at, *_ in CASES]
    sight = ObjectSight(
        layout,
        wp.array(qpos, device=device),
        wp.full((n, 1), wp.vec3(*CAMERA), dtype=wp.vec3, device=device),
        wp.array(np.tile(LEVEL, (n, 1, 1, 1)), dtype=wp.mat33, device=device),
        object_column=FIRST,
        camera_site=0,
        tan_half_fov=TAN,
        near=NEAR,
        far=FAR,
        occlusion=occlusion,
    )
    sight.update()
    assert sight.seen.numpy().tolist() == [seen if occlusion else open_ for _, seen, open_ in CASES]
