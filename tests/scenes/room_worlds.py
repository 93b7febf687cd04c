"""Scenes of families and distances in them by NumPy, shared by the tests of families."""

import numpy as np
import warp as wp

from spin_rl.planning.distance_field import DistanceField
from spin_rl.scenes.kinds import FAMILIES
from spin_rl.scenes.layout import Layout, Scene
from spin_rl.scenes.rooms.generator import FamilyGenerator
from spin_rl.scenes.rooms.params import BLOCKED_M, FamilyParams, Shares


def only(family: str, **parameters) -> FamilyParams:
    """Parameters that draw one family alone."""
    return FamilyParams(shares=Shares(**{name: float(name == family) for name in FAMILIES}), **parameters)


def inputs(nworld, device, *, seed=0, mask=None):
    """Arguments of the steps of `FamilyGenerator`."""
    mask = np.ones(nworld, dtype=bool) if mask is None else mask
    return {
        "seed": wp.array([seed], dtype=wp.int32, device=device),
        "counter": wp.zeros(nworld, dtype=wp.int32, device=device),
        "mask": wp.array(mask, dtype=bool, device=device),
    }


def distances(scene: Scene, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Distance on the floor from points to the nearest thing that is lower than 1.45 m [m]."""
    nearest = np.full(np.broadcast_shapes(x.shape, y.shape), np.inf)
    for slot in np.flatnonzero(scene.active):
        if scene.pos[slot, 2] - scene.half_size[slot, 2] > 1.45:
            continue
        dx, dy = x - scene.pos[slot, 0], y - scene.pos[slot, 1]
        if scene.is_cylinder[slot]:
            nearest = np.minimum(nearest, np.hypot(dx, dy) - scene.half_size[slot, 0])
            continue
        c, s = np.cos(scene.yaw[slot]), np.sin(scene.yaw[slot])
        along = np.abs(c * dx + s * dy) - scene.half_size[slot, 0]
        across = np.abs(c * dy - s * dx) - scene.half_size[slot, 1]
        nearest = np.minimum(nearest, np.hypot(np.maximum(along, 0), np.maximum(across, 0)))
    return nearest


def generate(nworld, device, params, *, seed=0, mask=None, layout=None, field=None, counter=None) -> Layout:
    """New scenes with starts."""
    layout = layout or Layout(nworld, params.pool, device)
    field = field or DistanceField(layout, device, blocked_m=BLOCKED_M)
    arguments = inputs(nworld, device, seed=seed, mask=mask)
    if counter is not None:
        arguments["counter"] = counter
    generator = FamilyGenerator(layout, params)
    generator.build(**arguments)
    field.update(layout.goal, arguments["mask"])
    generator.place_starts(field.field, **arguments)
    return layout
