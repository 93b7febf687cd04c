"""Inputs of the generator and NumPy views of its output, shared by the scene tests."""

import numpy as np
import warp as wp

from spin_rl.scenes.corridors.generator import generate_layouts
from spin_rl.scenes.corridors.params import GeneratorParams
from spin_rl.scenes.layout import Layout, PoolSpec, Scene

PARAMS = GeneratorParams()


def inputs(nworld, device, *, seed=0, scenario=0, difficulty=-1, level=1.0, mask=None):
    """Arguments of generate_layouts."""
    mask = np.ones(nworld, dtype=bool) if mask is None else mask
    return {
        "seed": wp.array([seed], dtype=wp.int32, device=device),
        "counter": wp.zeros(nworld, dtype=wp.int32, device=device),
        "mask": wp.array(mask, dtype=bool, device=device),
        "scenario_choice": wp.full(nworld, scenario, dtype=wp.int32, device=device),
        "difficulty_choice": wp.full(nworld, difficulty, dtype=wp.int32, device=device),
        "level": wp.full(nworld, level, dtype=float, device=device),
    }


def generate(nworld, device, *, params=PARAMS, pool=None, **choices) -> Layout:
    """A new layout."""
    layout = Layout(nworld, pool or PoolSpec(), device)
    generate_layouts(layout, params, **inputs(nworld, device, **choices))
    return layout


def values(layout: Layout) -> dict[str, np.ndarray]:
    """All per-world arrays on the host."""
    return {name: getattr(layout, name).numpy().copy() for name in Layout._PER_WORLD}


def corners(scene: Scene, slot: int) -> np.ndarray:
    """The four corners of a slot's bounding rectangle on the floor, shape (4, 2)."""
    c, s = np.cos(scene.yaw[slot]), np.sin(scene.yaw[slot])
    signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    return scene.pos[slot, :2] + (signs * scene.half_size[slot, :2]) @ np.array([[c, s], [-s, c]])


def obstacles(scene: Scene) -> list[int]:
    """Slots of the obstacles, without walls and distractors."""
    boxes = [s for s in range(scene.pool.first_box, scene.pool.first_cylinder) if scene.active[s]]
    cylinders = [s for s in range(scene.pool.first_cylinder, scene.pool.num_slots) if scene.active[s]]
    return boxes[: scene.num_obstacles - len(cylinders)] + cylinders


def distractors(scene: Scene) -> list[int]:
    """Slots of the boxes outside the walls."""
    active = set(np.flatnonzero(scene.active & ~scene.is_wall).tolist())
    return sorted(active - set(obstacles(scene)))


def legs(scene: Scene, width: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Free rectangles (low, high) of the corridor, recomputed from start, goal and walls."""
    half = 0.5 * width
    wall = scene.pos, scene.half_size
    if scene.bend == 0:
        back = wall[0][2, 0] + wall[1][2, 0]
        front = wall[0][3, 0] - wall[1][3, 0]
        return [(np.array([back, -half]), np.array([front, half]))]
    corner, side = scene.goal[0], np.sign(scene.goal[1])
    back = wall[0][4, 0] + wall[1][4, 0]
    end = abs(wall[0][5, 1]) - wall[1][5, 1]
    ys = sorted([-side * half, side * end])
    return [
        (np.array([back, -half]), np.array([corner + half, half])),
        (np.array([corner - half, ys[0]]), np.array([corner + half, ys[1]])),
    ]
