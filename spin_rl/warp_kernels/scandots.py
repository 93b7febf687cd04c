# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportInvalidTypeForm=false
# pyright: reportCallIssue=false, reportIndexIssue=false, reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Scandots: what the robot may know about each obstacle, as tokens (``spin_rl.warp_kernels.tokens``).

Source: SPIN paper, "Phase 1" (scandots s_t, mask F) and the local visibility paragraph of the implementation
details (2 m in all four directions; corners are projected onto the image plane).

Boxes and cylinders (by their bounding box, turned by the slot's yaw) are masked corner by corner:

- window: ``|x_b| <= window`` and ``|y_b| <= window``, a square around the base;
- frustum: depth >= near, and inside the image;
- line of sight (optional): no active slot, its own box included, stands on the segment from the camera to
  the corner. A cylinder hides what is behind the cylinder, not what is behind its bounding box. The robot's
  own body hides nothing. A camera inside a slot sees nothing.

A wall is longer than the window, so its own corners say little. Its token is a *piece* of the wall: cut along
the long axis, as thick as the wall, with all 8 flags set.

- window: on the face towards the base, take the part of the horizontal centre line that lies in the window.
  The piece spans it, at the full height of the wall. If no part is inside, the token is empty.
- visible: along that piece, the same face is sampled by ``WALL_COLUMNS`` vertical lines, ends included. Each
  is clipped to the frustum, and its low end, middle, and high end are tested for line of sight. The piece
  spans the samples that pass, along the wall and in height. If none passes, the token is empty.

A long box that is not marked as a wall and crosses the window without a corner inside gives an empty token,
and one whose corners are all outside the image is not seen, however much of it is in view: so is a couch
right before the robot. Therefore slots whose length or height is more than ``pieces_from`` are told by pieces
as walls are: of a long side, or of an end if the base is right before that. ``pieces_from`` 0 leaves that to
walls, as in the paper.
"""

import warp as wp

from spin_rl.warp_kernels.geometry import MISS, clip_slab, rotate_yaw, rotate_yaw_inverse
from spin_rl.warp_kernels.slots import Slots
from spin_rl.warp_kernels.tokens import Base, clear_token, nearest_corner, to_base, token_corner, write_token
from spin_rl.warp_kernels.visibility import (
    Box,
    Camera,
    Points,
    clip_to_frustum,
    in_frustum,
    remove_hidden,
)

WALL_COLUMNS = wp.constant(10)
"""Vertical lines on which a wall is sampled, 3 samples each; at most ``MAX_POINTS`` samples."""

_ALL_CORNERS = wp.constant(0xFF)

wp.set_module_options({"enable_backward": False})


@wp.func
def _write_box(
    world: int,
    token: int,
    base: Base,
    camera: Camera,
    box: Box,
    obstacles: Slots,
    nearby: wp.array2d[int],
    occlusion: bool,
    all_out: wp.array3d[float],
    visible_out: wp.array3d[float],
):
    """Mask the corners of a box, or of a cylinder's bounding box, one by one."""
    nearest = nearest_corner(box, base.pos)
    points = Points()
    inside = int(0)
    visible = int(0)
    for index in range(8):
        corner = token_corner(box, nearest, index)
        corner_b = to_base(base, corner)
        if wp.abs(corner_b[0]) <= base.window and wp.abs(corner_b[1]) <= base.window:
            inside = inside | (1 << index)
            if in_frustum(camera, corner):
                visible = visible | (1 << index)
                points[index, 0] = corner[0]
                points[index, 1] = corner[1]
                points[index, 2] = corner[2]
    if occlusion and visible != 0:
        visible = remove_hidden(points, 8, visible, camera, box, obstacles, nearby, world)
    write_token(world, token, base, box, inside, all_out)
    write_token(world, token, base, box, visible, visible_out)


@wp.func
def _long_side_first(box: Box) -> Box:
    """The same box, described in a frame whose x axis is the longer horizontal side."""
    turned = box
    if box.half_size[1] > box.half_size[0]:
        turned.half_size = wp.vec3(box.half_size[1], box.half_size[0], box.half_size[2])
        turned.cos_yaw = -box.sin_yaw
        turned.sin_yaw = box.cos_yaw
    return turned


@wp.func
def _end_first(box: Box) -> Box:
    """The same box, described in a frame whose x axis is the shorter horizontal side; x is the longer one."""
    turned = box
    turned.half_size = wp.vec3(box.half_size[1], box.half_size[0], box.half_size[2])
    turned.cos_yaw = -box.sin_yaw
    turned.sin_yaw = box.cos_yaw
    return turned


@wp.func
def _is_before_end(box: Box, point: wp.vec3) -> bool:
    """Whether a point is beyond an end of a box whose x axis is the longer side, and within its width."""
    local = rotate_yaw_inverse(point - box.pos, box.cos_yaw, box.sin_yaw)
    return wp.abs(local[1]) <= box.half_size[1] and wp.abs(local[0]) > box.half_size[0]


@wp.func
def _cut_wall(wall: Box, low: float, high: float, bottom: float, top: float) -> Box:
    """The piece of a wall between two positions along its x axis and two heights."""
    piece = wall
    local = wp.vec3(0.5 * (low + high), 0.0, 0.5 * (bottom + top) - wall.pos[2])
    piece.pos = wall.pos + rotate_yaw(local, wall.cos_yaw, wall.sin_yaw)
    piece.half_size = wp.vec3(0.5 * (high - low), wall.half_size[1], 0.5 * (top - bottom))
    return piece


@wp.func
def _seen_piece(wall: Box, start: float, spacing: float, samples: Points, seen: int) -> Box:
    """The piece of a wall that spans the samples whose bit is set in ``seen`` (at least one)."""
    low = float(MISS)
    high = float(-MISS)
    bottom = float(MISS)
    top = float(-MISS)
    for index in range(3 * WALL_COLUMNS):
        if (seen & (1 << index)) != 0:
            along = start + float(index // 3) * spacing
            low = wp.min(low, along)
            high = wp.max(high, along)
            bottom = wp.min(bottom, samples[index, 2])
            top = wp.max(top, samples[index, 2])
    return _cut_wall(wall, low, high, bottom, top)


@wp.func
def _write_wall(
    world: int,
    token: int,
    base: Base,
    camera: Camera,
    wall: Box,
    obstacles: Slots,
    nearby: wp.array2d[int],
    occlusion: bool,
    all_out: wp.array3d[float],
    visible_out: wp.array3d[float],
):
    """Cut a wall (x axis along it) to the window, and that piece to what the camera sees of its face."""
    half = wall.half_size
    # The bottom edge on the side of the base: foot + s * direction, |s| <= half[0].
    side = nearest_corner(wall, base.pos)[1]
    to_foot = rotate_yaw(wp.vec3(0.0, side * half[1], -half[2]), wall.cos_yaw, wall.sin_yaw)
    direction = wp.vec3(wall.cos_yaw, wall.sin_yaw, 0.0)
    foot_b = to_base(base, wall.pos + to_foot)
    direction_b = rotate_yaw_inverse(direction, base.cos_yaw, base.sin_yaw)
    span = clip_slab(wp.vec2(-half[0], half[0]), foot_b[0], direction_b[0], base.window)
    span = clip_slab(span, foot_b[1], direction_b[1], base.window)
    if span[0] > span[1]:
        clear_token(world, token, all_out)
        clear_token(world, token, visible_out)
        return
    bottom = wall.pos[2] - half[2]
    piece = _cut_wall(wall, span[0], span[1], bottom, bottom + 2.0 * half[2])
    write_token(world, token, base, piece, _ALL_CORNERS, all_out)

    spacing = (span[1] - span[0]) / float(WALL_COLUMNS - 1)
    samples = Points()
    seen = int(0)
    for column in range(WALL_COLUMNS):
        foot = wall.pos + to_foot + (span[0] + float(column) * spacing) * direction
        heights = clip_to_frustum(camera, foot, 2.0 * half[2])
        if heights[0] <= heights[1]:
            for level in range(3):
                index = 3 * column + level
                seen = seen | (1 << index)
                samples[index, 0] = foot[0]
                samples[index, 1] = foot[1]
                samples[index, 2] = foot[2] + heights[0] + 0.5 * float(level) * (heights[1] - heights[0])
    if occlusion and seen != 0:
        face = wall
        face.pos += rotate_yaw(wp.vec3(0.0, side * half[1], 0.0), wall.cos_yaw, wall.sin_yaw)
        face.half_size = wp.vec3(half[0], 0.0, half[2])
        face = _seen_piece(face, span[0], spacing, samples, seen)
        seen = remove_hidden(samples, 3 * WALL_COLUMNS, seen, camera, face, obstacles, nearby, world)
    if seen == 0:
        clear_token(world, token, visible_out)
        return
    piece = _seen_piece(wall, span[0], spacing, samples, seen)
    write_token(world, token, base, piece, _ALL_CORNERS, visible_out)


@wp.kernel
def _write_scandots(
    obstacles: Slots,
    is_wall: wp.array[wp.bool],
    nearby: wp.array2d[int],
    qpos: wp.array2d[float],
    site_xpos: wp.array2d[wp.vec3],
    site_xmat: wp.array2d[wp.mat33],
    camera_site: int,
    tan_half_fov: wp.vec2,
    near: float,
    window: float,
    occlusion: bool,
    pieces_from: float,
    all_out: wp.array3d[float],
    visible_out: wp.array3d[float],
):
    world, token = wp.tid()
    slot = nearby[world, token]
    if slot < 0:
        clear_token(world, token, all_out)
        clear_token(world, token, visible_out)
        return
    box = Box()
    box.pos = obstacles.pos[world, slot]
    box.half_size = obstacles.half_size[world, slot]
    base = Base()
    base.pos = wp.vec3(qpos[world, 0], qpos[world, 1], 0.0)
    base.window = window
    # No point of the slot is nearer to the base than this; the window's own corners are at sqrt(2) window.
    offset = box.pos - base.pos
    clearance = wp.length(wp.vec2(offset[0], offset[1])) - wp.length(
        wp.vec2(box.half_size[0], box.half_size[1])
    )
    if not obstacles.active[world, slot] or clearance > 1.4143 * window:
        clear_token(world, token, all_out)
        clear_token(world, token, visible_out)
        return

    base.cos_yaw = wp.cos(qpos[world, 2])
    base.sin_yaw = wp.sin(qpos[world, 2])
    box.cos_yaw = wp.cos(obstacles.yaw[world, slot])
    box.sin_yaw = wp.sin(obstacles.yaw[world, slot])
    camera = Camera()
    camera.pos = site_xpos[world, camera_site]
    camera.to_cam = wp.transpose(site_xmat[world, camera_site])
    camera.tan_half_fov = tan_half_fov
    camera.near = near
    largest = 2.0 * wp.max(box.half_size[0], wp.max(box.half_size[1], box.half_size[2]))
    in_pieces = pieces_from > 0.0 and largest > pieces_from
    if is_wall[slot] or in_pieces:
        wall = _long_side_first(box)
        if not is_wall[slot] and _is_before_end(wall, base.pos):
            wall = _end_first(wall)
        _write_wall(world, token, base, camera, wall, obstacles, nearby, occlusion, all_out, visible_out)
    else:
        _write_box(world, token, base, camera, box, obstacles, nearby, occlusion, all_out, visible_out)


def scandot_tokens(
    obstacles: Slots,
    is_wall: wp.array,
    nearby: wp.array,
    qpos: wp.array,
    site_xpos: wp.array,
    site_xmat: wp.array,
    *,
    camera_site: int,
    tan_half_fov: tuple[float, float],
    near: float,
    window: float,
    occlusion: bool,
    pieces_from: float,
    all_out: wp.array,
    visible_out: wp.array,
) -> None:
    """Write the scandot tokens of the slots nearby: those in the local window, and those that are seen.

    The rules are in the module's docstring. Graph-safe; the six options freeze at capture.

    Args:
        obstacles: Walls and obstacles; slots that are not active give zeros and hide nothing.
        is_wall: Whether a slot is a wall, shape (nslot,), bool.
        nearby: Slots that have a token and may hide others, in the order of the tokens, negative ones behind
            the last, shape (nworld, k), int32.
        qpos: Joint positions, shape (nworld, nq); columns 0 to 2 are the base's x, y [m] and yaw [rad].
        site_xpos: Site positions in the world [m], shape (nworld, nsite), vec3.
        site_xmat: Site-to-world rotations, shape (nworld, nsite), mat33.
        camera_site: Index of the camera's optical frame (x right, y down, z forward) among the sites.
        tan_half_fov: Tangent of half the field of view along the optical x and y axes.
        near: Smallest depth that the camera sees [m].
        window: Half side of the square local window [m].
        occlusion: Whether obstacles hide corners from the camera.
        pieces_from: Length or height of slots from which they are told as walls are [m], 0 for walls alone.
        all_out: Output, corners in the window whether seen or not, shape (nworld, k, 32), float.
        visible_out: Output, corners that are also seen, shape (nworld, k, 32), float.
    """
    wp.launch(
        _write_scandots,
        dim=nearby.shape,
        inputs=[
            obstacles,
            is_wall,
            nearby,
            qpos,
            site_xpos,
            site_xmat,
            camera_site,
            wp.vec2(*tan_half_fov),
            near,
            window,
            occlusion,
            pieces_from,
        ],
        outputs=[all_out, visible_out],
        device=obstacles.pos.device,
    )
