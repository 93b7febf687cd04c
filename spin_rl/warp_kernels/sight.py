# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportInvalidTypeForm=false
# pyright: reportCallIssue=false, reportIndexIssue=false, reportOperatorIssue=false, reportArgumentType=false
# pyright: reportAttributeAccessIssue=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""From which of many head poses the camera would show which obstacle, all from one state of the robot.

An obstacle is shown if one of the corners of its box (a cylinder's bounding box) is: inside the window, in
front of the camera and in its image, with nothing in between, as in `scandots`. Here the robot's own body
hides, too.
"""

from typing import Any

import warp as wp

from spin_rl.warp_kernels.geometry import ray_box, ray_cylinder
from spin_rl.warp_kernels.slots import Slots
from spin_rl.warp_kernels.tokens import Base, nearest_corner, to_base, token_corner
from spin_rl.warp_kernels.visibility import SIGHT_MARGIN_M, Box, Camera, Points, in_frustum, remove_hidden

BITS = 32
"""Poses in one word of the result."""

_BOX = wp.constant(0)

wp.set_module_options({"enable_backward": False})


@wp.struct
class Body:
    """What of the robot hides: boxes and cylinders in any direction.

    ``xpos`` and ``xmat`` (nworld, ngeom) are where all geoms are; ``geoms`` (n,) says which of them hide,
    ``kinds`` (n,) 0 for a box and 1 for a cylinder along z, ``sizes`` (n,) half extents, or (radius, radius,
    half height).
    """

    xpos: wp.array2d[wp.vec3]
    xmat: wp.array2d[wp.mat33]
    geoms: wp.array[int]
    kinds: wp.array[int]
    sizes: wp.array[wp.vec3]


@wp.struct
class Heads:
    """Cameras of all head poses in the base frame, axes x right, y down, z forward, and their lens."""

    pos: wp.array[wp.vec3]
    mat: wp.array[wp.mat33]
    tan_half_fov: wp.vec2
    near: float


@wp.func
def _body_hides(world: int, origin: wp.vec3, target: wp.vec3, body: Body) -> bool:
    """Whether a geom of the body is on the way from a camera to a point."""
    full = target - origin
    ray = (1.0 - SIGHT_MARGIN_M / wp.length(full)) * full
    for i in range(body.geoms.shape[0]):
        geom = body.geoms[i]
        to_geom = wp.transpose(body.xmat[world, geom])
        start = to_geom * (origin - body.xpos[world, geom])
        direction = to_geom * ray
        size = body.sizes[i]
        hit = float(0.0)
        if body.kinds[i] == _BOX:
            hit = ray_box(start, direction, size)
        else:
            hit = ray_cylinder(start, direction, size[0], size[2])
        if hit < 1.0:
            return True
    return False


@wp.kernel
def _look(
    # In
    slots: Slots,
    hiding: Slots,
    is_wall: wp.array[wp.bool],
    nearby: wp.array2d[int],
    qpos: wp.array2d[float],
    body: Body,
    heads: Heads,
    window: float,
    # Out
    shown_out: wp.array3d[wp.uint32],
) -> None:
    world, slot = wp.tid()
    for word in range(shown_out.shape[2]):
        shown_out[world, slot, word] = wp.uint32(0)
    if is_wall[slot] or not slots.active[world, slot]:
        return
    base = Base()
    base.pos = wp.vec3(qpos[world, 0], qpos[world, 1], 0.0)
    base.cos_yaw = wp.cos(qpos[world, 2])
    base.sin_yaw = wp.sin(qpos[world, 2])
    box = Box()
    box.pos = slots.pos[world, slot]
    box.half_size = slots.half_size[world, slot]
    box.cos_yaw = wp.cos(slots.yaw[world, slot])
    box.sin_yaw = wp.sin(slots.yaw[world, slot])
    nearest = nearest_corner(box, base.pos)
    corners = Points()
    inside = int(0)
    for index in range(8):
        corner = token_corner(box, nearest, index)
        corner_b = to_base(base, corner)
        if wp.abs(corner_b[0]) <= window and wp.abs(corner_b[1]) <= window:
            inside = inside | (1 << index)
        for axis in range(3):
            corners[index, axis] = corner[axis]
    if inside == 0:
        return
    turn = wp.mat33(
        base.cos_yaw, -base.sin_yaw, 0.0, base.sin_yaw, base.cos_yaw, 0.0, 0.0, 0.0, 1.0
    )  # fmt: skip
    camera = Camera()
    camera.tan_half_fov = heads.tan_half_fov
    camera.near = heads.near
    for pose in range(heads.pos.shape[0]):
        camera.pos = base.pos + turn * heads.pos[pose]
        camera.to_cam = wp.transpose(turn * heads.mat[pose])
        seen = int(0)
        for index in range(8):
            if (inside & (1 << index)) != 0:
                if in_frustum(camera, wp.vec3(corners[index, 0], corners[index, 1], corners[index, 2])):
                    seen = seen | (1 << index)
        if seen != 0:
            seen = remove_hidden(corners, 8, seen, camera, box, hiding, nearby, world)
        shown = bool(False)
        for index in range(8):
            if not shown and (seen & (1 << index)) != 0:
                corner = wp.vec3(corners[index, 0], corners[index, 1], corners[index, 2])
                shown = not _body_hides(world, camera.pos, corner, body)
        if shown:
            bit = wp.uint32(1) << wp.uint32(pose % BITS)
            shown_out[world, slot, pose // BITS] = shown_out[world, slot, pose // BITS] | bit


def look(
    slots: Any,
    hiding: Any,
    is_wall: wp.array,
    nearby: wp.array,
    qpos: wp.array,
    body: Any,
    heads: Any,
    *,
    window: float,
    shown_out: wp.array,
) -> None:
    """Write from which head poses the camera would show every obstacle, in all worlds; graph-safe.

    Args:
        slots: `Slots`, what may be shown; walls are not.
        hiding: `Slots`, what hides: the same, or with fewer active.
        is_wall: Whether a slot is a wall, shape (nslot,), bool.
        nearby: Slots that may hide, negative ones behind the last, shape (nworld, k), int32.
        qpos: Positions; columns 0 to 2 are the base's x, y [m] and yaw [rad], shape (nworld, nq).
        body: `Body`.
        heads: `Heads` of npose poses.
        window: Half side of the square window around the base [m].
        shown_out: Output, bit i of word j is that of pose 32 j + i, shape (nworld, nslot,
            (npose + 31) // 32), uint32.
    """
    wp.launch(
        _look,
        dim=slots.active.shape,
        inputs=[slots, hiding, is_wall, nearby, qpos, body, heads, window],
        outputs=[shown_out],
        device=shown_out.device,
    )
