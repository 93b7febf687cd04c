"""Small worlds with distance fields, and their values and distances on the host."""

import numpy as np
import warp as wp

from spin_rl.planning.distance_field import DistanceField, GridSpec
from spin_rl.scenes.layout import Layout, PoolSpec, Scene
from spin_rl.warp_kernels.distance_field.field import UNREACHABLE, Field, field_at

POOL = PoolSpec(0, 60, 4)


@wp.kernel
def _read(field: Field, points: wp.array2d[wp.vec2], values_out: wp.array2d[float]):
    world, i = wp.tid()
    values_out[world, i] = field_at(field, world, points[world, i][0], points[world, i][1])


def read(fields, points) -> np.ndarray:
    """Values at points of shape (nworld, npoint, 2), or (npoint, 2) in world 0."""
    shape = np.shape(points)[:-1]
    device = fields.field.values.device
    array = wp.array(np.reshape(points, (-1, *np.shape(points)[-2:])), dtype=wp.vec2, device=device)
    values = wp.zeros(array.shape, dtype=float, device=device)
    wp.launch(_read, dim=array.shape, inputs=[fields.field, array], outputs=[values], device=device)
    return values.numpy().reshape(shape)


def scene_of(*boxes, cylinders=(), goal=(2.0, 0.0), start=(-2.0, 0.0)) -> Scene:
    """Boxes (x, y, half x, half y[, yaw[, bottom]]), 1 m high, and cylinders (x, y, radius)."""
    scene = Scene.empty(POOL)
    for slot, box in enumerate(boxes):
        x, y, half_x, half_y, yaw, bottom = (*box, 0.0, 0.0)[:6]
        scene.pos[slot], scene.half_size[slot] = (x, y, bottom + 0.5), (half_x, half_y, 0.5)
        scene.yaw[slot], scene.active[slot] = yaw, True
    for slot, (x, y, radius) in enumerate(cylinders, POOL.first_cylinder):
        scene.pos[slot], scene.half_size[slot], scene.active[slot] = (x, y, 0.5), (radius, radius, 0.5), True
    scene.start[:2], scene.goal[:] = start, goal
    return scene


def layout_of(scenes, device) -> Layout:
    layout = Layout(len(scenes), scenes[0].pool, device)
    for name in Layout._PER_WORLD:
        getattr(layout, name).assign(np.array([getattr(scene, name) for scene in scenes]))
    return layout


def solve(scenes, device, grid=None, **distances) -> DistanceField:
    """Fields and ways of scenes."""
    layout = layout_of(scenes, device)
    fields = DistanceField(layout, device, grid, **distances)
    everywhere = wp.full(len(scenes), True, dtype=bool, device=device)
    fields.update(layout.goal, everywhere)
    fields.trace(layout.start, everywhere)
    return fields


def reachable(scenes, device, grid=None, **distances) -> np.ndarray:
    """Whether the starts reach the goals."""
    fields = solve(scenes, device, grid, **distances)
    values = read(fields, np.array([scene.start[None, :2] for scene in scenes]))[:, 0]
    np.testing.assert_array_equal(fields.path_length.numpy() < UNREACHABLE, values < UNREACHABLE)
    return values < UNREACHABLE


def distance(scene, points) -> np.ndarray:
    """Distance of points (..., 2) to the nearest slot, seen from above."""
    nearest = np.full(points.shape[:-1], np.inf)
    for slot in np.flatnonzero(scene.active):
        offset = points - scene.pos[slot, :2]
        turn = np.exp(-1j * scene.yaw[slot]) * (offset[..., 0] + 1j * offset[..., 1])
        half = scene.half_size[slot]
        if scene.is_cylinder[slot]:
            outside = np.maximum(np.abs(turn) - half[0], 0.0)
        else:
            outside = np.hypot(
                np.maximum(np.abs(turn.real) - half[0], 0), np.maximum(np.abs(turn.imag) - half[1], 0)
            )
        nearest = np.minimum(nearest, outside)
    return nearest


def centres(grid: GridSpec) -> np.ndarray:
    """Centres of the cells, shape (ny, nx, 2)."""
    x, y = (grid.origin[i] + grid.cell_m * (0.5 + np.arange(n)) for i, n in enumerate((grid.nx, grid.ny)))
    return np.stack(np.meshgrid(x, y), axis=-1)


def scattered(seed, count=30, reach=2.6) -> Scene:
    """A closed room with boxes and cylinders, apart from start and goal; around the latter is more room."""
    rng = np.random.default_rng(seed)
    walls = [(side * 3.05, 0.0, 0.05, 3.1) for side in (-1, 1)] + [
        (0.0, side * 3.05, 3.1, 0.05) for side in (-1, 1)
    ]
    boxes = rng.uniform((-reach, -reach, 0.05, 0.05, -3.0), (reach, reach, 0.5, 0.3, 3.0), (count, 5))
    cylinders = rng.uniform((-reach, -reach, 0.05), (reach, reach, 0.2), (4, 3))
    scene = scene_of(*walls, *boxes, cylinders=cylinders, start=(-2.5, -2.5), goal=(1.73, 1.64))
    for end, room in ((scene.start[:2], 0.5), (scene.goal, 1.15)):
        for slot in range(4, POOL.num_slots):
            alone = scene_of(start=end)
            for name in ("pos", "yaw", "half_size", "active"):
                getattr(alone, name)[slot] = getattr(scene, name)[slot]
            if distance(alone, end) < room:
                scene.active[slot] = False
    return scene


ROOM = GridSpec.square(7.0)
