# pyright: reportGeneralTypeIssues=false, reportIndexIssue=false, reportOperatorIssue=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Scandot tokens: the corners of a box in the base frame, and which of them are known.

A token is 32 floats: 8 corners (x, y, z) in the base frame [m], then 8 flags (1 known, 0 not). A corner
that is not known is zeros. Corners start at the xy corner nearest to the base and go counter-clockwise, the
bottom four first, then the top four.
"""

import warp as wp

from spin_rl.warp_kernels.geometry import rotate_yaw, rotate_yaw_inverse
from spin_rl.warp_kernels.visibility import Box

NUM_CORNERS = 8
TOKEN_SIZE = 4 * NUM_CORNERS

wp.set_module_options({"enable_backward": False})


@wp.struct
class Base:
    """Pose of the base on the floor, and the half side of the window around it."""

    pos: wp.vec3
    cos_yaw: float
    sin_yaw: float
    window: float


@wp.func
def to_base(base: Base, point: wp.vec3) -> wp.vec3:
    """A world point in the base frame."""
    return rotate_yaw_inverse(point - base.pos, base.cos_yaw, base.sin_yaw)


@wp.func
def nearest_corner(box: Box, point: wp.vec3) -> wp.vec2:
    """Signs, in the box frame, of the vertical edge nearest to a point."""
    local = rotate_yaw_inverse(point - box.pos, box.cos_yaw, box.sin_yaw)
    return wp.vec2(wp.where(local[0] < 0.0, -1.0, 1.0), wp.where(local[1] < 0.0, -1.0, 1.0))


@wp.func
def token_corner(box: Box, nearest: wp.vec2, index: int) -> wp.vec3:
    """World position of a corner in token order, which starts at ``nearest``."""
    sign_x = nearest[0]
    sign_y = nearest[1]
    # A quarter turn maps the signs (x, y) of a corner to (-y, x), those of the next one.
    if (index & 1) == 1:
        sign_x = -nearest[1]
        sign_y = nearest[0]
    if (index & 2) == 2:
        sign_x = -sign_x
        sign_y = -sign_y
    sign_z = wp.where(index < 4, -1.0, 1.0)
    half = box.half_size
    local = wp.vec3(sign_x * half[0], sign_y * half[1], sign_z * half[2])
    return box.pos + rotate_yaw(local, box.cos_yaw, box.sin_yaw)


@wp.func
def write_token(world: int, slot: int, base: Base, box: Box, known: int, out: wp.array3d[float]):
    """Write one token: the corners whose bit is set in ``known``, zeros for the others."""
    nearest = nearest_corner(box, base.pos)
    for index in range(8):
        flag = float(0.0)
        corner = wp.vec3(0.0)
        if (known & (1 << index)) != 0:
            flag = 1.0
            corner = to_base(base, token_corner(box, nearest, index))
        out[world, slot, 3 * index] = corner[0]
        out[world, slot, 3 * index + 1] = corner[1]
        out[world, slot, 3 * index + 2] = corner[2]
        out[world, slot, 24 + index] = flag


@wp.func
def clear_token(world: int, slot: int, out: wp.array3d[float]):
    for index in range(32):
        out[world, slot, index] = 0.0
