"""Which poses of the stowed robot touch something in a scene: its collision geoms against every slot.

Written out here, with NumPy, so that what checks the scenes shares no code with what generates them.
"""

from __future__ import annotations

from functools import lru_cache

import mujoco
import numpy as np

from spin_rl import robot
from spin_rl.scenes.layout import Scene

MARGIN_M = 0.01
"""Distance that is kept from everything, which covers the way between lattice points."""


@lru_cache(maxsize=16)
def robot_columns(lift: float) -> np.ndarray:
    """Bounding boxes of the stowed robot's collision geoms in the base frame.

    Args:
        lift: Lift position [m].

    Returns:
        Low and high corners [m], shape (ngeom, 2, 3).
    """
    model = robot.load_spec().compile()
    data = mujoco.MjData(model)
    data.qpos[:] = robot.qpos_from_joints(model, {**robot.STOWED, "lift": lift})
    mujoco.mj_forward(model, data)
    columns = []
    for geom in np.flatnonzero((model.geom_contype != 0) | (model.geom_conaffinity != 0)):
        rotation = np.abs(data.geom_xmat[geom].reshape(3, 3))
        size = model.geom_size[geom]
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE:
            half = rotation[:, 2] * size[1] + size[0]
            centre = data.geom_xpos[geom]
        else:
            half = rotation @ model.geom_aabb[geom, 3:]
            centre = data.geom_xpos[geom] + data.geom_xmat[geom].reshape(3, 3) @ model.geom_aabb[geom, :3]
        columns.append((centre - half, centre + half))
    return np.array(columns)


def blocked_poses(
    scene: Scene, x: np.ndarray, y: np.ndarray, headings: np.ndarray, lift: float
) -> np.ndarray:
    """Which base poses of a lattice touch something, the arm stowed.

    Args:
        scene: The world.
        x: Positions along x [m], ascending, shape (nx,).
        y: Positions along y [m], ascending, shape (ny,).
        headings: Yaws [rad], shape (n,).
        lift: Lift position [m].

    Returns:
        Shape (n, ny, nx), bool.
    """
    columns = robot_columns(lift)
    blocked = np.zeros((len(headings), len(y), len(x)), dtype=bool)
    for slot in np.flatnonzero(scene.active):
        centre, half = scene.pos[slot], scene.half_size[slot] + MARGIN_M
        slot_extent = extent(half, scene.yaw[slot])
        is_cylinder = bool(scene.is_cylinder[slot])
        hit = (columns[:, 1, 2] > centre[2] - half[2]) & (columns[:, 0, 2] < centre[2] + half[2])
        for low, high in _outermost(columns[hit]):
            part_half, part_centre = 0.5 * (high - low)[:2], 0.5 * (high + low)[:2]
            for heading, yaw in enumerate(headings):
                # Where the base is when this part of it is over the slot.
                c, s = np.cos(yaw), np.sin(yaw)
                middle = centre[:2] - (
                    c * part_centre[0] - s * part_centre[1],
                    s * part_centre[0] + c * part_centre[1],
                )
                reach = slot_extent + extent(part_half, yaw)
                ix = slice(*np.searchsorted(x, (middle[0] - reach[0], middle[0] + reach[0])))
                iy = slice(*np.searchsorted(y, (middle[1] - reach[1], middle[1] + reach[1])))
                if ix.start == ix.stop or iy.start == iy.stop:
                    continue
                blocked[heading, iy, ix] |= _overlaps(
                    x[None, ix],
                    y[iy, None],
                    yaw,
                    part_centre,
                    part_half,
                    centre,
                    scene.yaw[slot],
                    half,
                    is_cylinder,
                )
    return blocked


def _outermost(columns: np.ndarray) -> np.ndarray:
    """The columns that, seen from above, do not lie inside another one."""
    low, high = columns[:, 0, :2], columns[:, 1, :2]
    inside = np.all((low[:, None] >= low) & (high[:, None] <= high), axis=2)
    np.fill_diagonal(inside, False)
    inside &= ~np.triu(inside & inside.T)  # of equal ones the first stays
    return columns[~inside.any(axis=1)]


def extent(half_size: np.ndarray, yaw: float) -> np.ndarray:
    """Half extents along the world's x and y [m] of a box turned by a yaw [rad], shape (2,)."""
    c, s = np.abs(np.cos(yaw)), np.abs(np.sin(yaw))
    return np.array([half_size[0] * c + half_size[1] * s, half_size[0] * s + half_size[1] * c])


def _overlaps(
    x: np.ndarray,
    y: np.ndarray,
    yaw: float,
    part_centre: np.ndarray,
    part_half: np.ndarray,
    centre: np.ndarray,
    slot_yaw: float,
    half: np.ndarray,
    is_cylinder: bool,
) -> np.ndarray:
    """Whether a rectangle on the robot overlaps a slot seen from above, for base positions (x, y)."""
    c, s = np.cos(yaw), np.sin(yaw)
    dx = x + (c * part_centre[0] - s * part_centre[1] - centre[0])
    dy = y + (s * part_centre[0] + c * part_centre[1] - centre[1])
    along, across = c * dx + s * dy, c * dy - s * dx
    if is_cylinder:
        outside_x = np.maximum(np.abs(along) - part_half[0], 0.0)
        outside_y = np.maximum(np.abs(across) - part_half[1], 0.0)
        return outside_x**2 + outside_y**2 < half[0] ** 2
    # Separating axes: two of the rectangle, two of the box.
    ct, st = np.abs(np.cos(yaw - slot_yaw)), np.abs(np.sin(yaw - slot_yaw))
    hit = (np.abs(along) < part_half[0] + half[0] * ct + half[1] * st) & (
        np.abs(across) < part_half[1] + half[0] * st + half[1] * ct
    )
    cs, ss = np.cos(slot_yaw), np.sin(slot_yaw)
    hit &= np.abs(cs * dx + ss * dy) < half[0] + part_half[0] * ct + part_half[1] * st
    hit &= np.abs(cs * dy - ss * dx) < half[1] + part_half[0] * st + part_half[1] * ct
    return hit
