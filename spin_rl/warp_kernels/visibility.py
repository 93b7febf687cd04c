# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportCallIssue=false
# pyright: reportIndexIssue=false, reportArgumentType=false, reportAttributeAccessIssue=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""What a pinhole camera sees among boxes and upright cylinders: frustum and line of sight."""

import warp as wp

from spin_rl.warp_kernels.geometry import clip_interval, ray_box, ray_cylinder, rotate_yaw_inverse
from spin_rl.warp_kernels.slots import Slots

SIGHT_MARGIN_M = wp.constant(0.015)
"""Rays stop this far before their target, so that the target's own surface does not hide it."""

MAX_POINTS = 30
"""Points that one call tests: their flags are the bits of one int."""

Points = wp.types.matrix(shape=(MAX_POINTS, 3), dtype=float)
"""World positions [m], one a row."""

wp.set_module_options({"enable_backward": False})


@wp.struct
class Camera:
    """Optical frame (x right, y down, z forward) and field of view."""

    pos: wp.vec3
    to_cam: wp.mat33
    tan_half_fov: wp.vec2
    near: float


@wp.struct
class Box:
    """A box with vertical sides, in the world."""

    pos: wp.vec3
    half_size: wp.vec3
    cos_yaw: float
    sin_yaw: float


@wp.func
def in_frustum(camera: Camera, point: wp.vec3) -> bool:
    """Whether a world point is in front of the camera and inside its image."""
    p = camera.to_cam * (point - camera.pos)
    tan = camera.tan_half_fov
    return p[2] >= camera.near and wp.abs(p[0]) <= tan[0] * p[2] and wp.abs(p[1]) <= tan[1] * p[2]


@wp.func
def clip_to_frustum(camera: Camera, foot: wp.vec3, height: float) -> wp.vec2:
    """Part (low, high) of a vertical line above ``foot`` that is in the frustum; low > high if none is."""
    p = camera.to_cam * (foot - camera.pos)
    up = wp.vec3(camera.to_cam[0, 2], camera.to_cam[1, 2], camera.to_cam[2, 2])
    tan = camera.tan_half_fov
    interval = clip_interval(wp.vec2(0.0, height), p[2] - camera.near, up[2])
    interval = clip_interval(interval, tan[0] * p[2] - p[0], tan[0] * up[2] - up[0])
    interval = clip_interval(interval, tan[0] * p[2] + p[0], tan[0] * up[2] + up[0])
    interval = clip_interval(interval, tan[1] * p[2] - p[1], tan[1] * up[2] - up[1])
    return clip_interval(interval, tan[1] * p[2] + p[1], tan[1] * up[2] + up[1])


@wp.func
def _beyond_side(camera: float, target: float, extent: float, half: float) -> bool:
    """Whether camera and target (half width ``extent``) lie on one side of the slab ``|x| <= half``."""
    limit = half - 1.0e-4
    return (camera >= limit and target - extent >= limit) or (camera <= -limit and target + extent <= -limit)


@wp.func
def remove_hidden(
    points: Points,
    num_points: int,
    candidates: int,
    camera: Camera,
    target: Box,
    obstacles: Slots,
    nearby: wp.array2d[int],
    world: int,
) -> int:
    """Clear the bits of those candidate points that the camera cannot see behind some active slot nearby.

    ``target`` is a box around the points: it lets most slots be skipped at once.
    """
    seen = int(candidates)
    target_radius = wp.length(wp.vec2(target.half_size[0], target.half_size[1]))
    target_offset = wp.vec2(target.pos[0] - camera.pos[0], target.pos[1] - camera.pos[1])
    target_distance_sq = wp.max(wp.dot(target_offset, target_offset), 1.0e-12)
    lowest = wp.min(camera.pos[2], target.pos[2] - target.half_size[2])
    highest = wp.max(camera.pos[2], target.pos[2] + target.half_size[2])
    rays = Points()
    for index in range(num_points):
        if (seen & (1 << index)) != 0:
            full = wp.vec3(points[index, 0], points[index, 1], points[index, 2]) - camera.pos
            ray = (1.0 - SIGHT_MARGIN_M / wp.length(full)) * full
            rays[index, 0] = ray[0]
            rays[index, 1] = ray[1]
            rays[index, 2] = ray[2]
    for k in range(nearby.shape[1]):
        other = nearby[world, k]
        if seen == 0 or other < 0:
            break
        if not obstacles.active[world, other]:
            continue
        centre = obstacles.pos[world, other]
        half = obstacles.half_size[world, other]
        if centre[2] + half[2] < lowest or centre[2] - half[2] > highest:
            continue
        # The rays lie within target_radius of the segment from the camera to the target's centre.
        offset = wp.vec2(centre[0] - camera.pos[0], centre[1] - camera.pos[1])
        along = wp.clamp(wp.dot(offset, target_offset) / target_distance_sq, 0.0, 1.0)
        reach = target_radius + wp.length(wp.vec2(half[0], half[1]))
        if wp.length_sq(offset - along * target_offset) > reach * reach:
            continue
        cos_yaw = wp.cos(obstacles.yaw[world, other])
        sin_yaw = wp.sin(obstacles.yaw[world, other])
        origin = rotate_yaw_inverse(camera.pos - centre, cos_yaw, sin_yaw)
        # Camera and target both beyond one side: typical of walls, whose bounding circle rejects little.
        offset_other = rotate_yaw_inverse(target.pos - centre, cos_yaw, sin_yaw)
        cos_between = wp.abs(cos_yaw * target.cos_yaw + sin_yaw * target.sin_yaw)
        sin_between = wp.abs(cos_yaw * target.sin_yaw - sin_yaw * target.cos_yaw)
        extent_x = cos_between * target.half_size[0] + sin_between * target.half_size[1]
        extent_y = sin_between * target.half_size[0] + cos_between * target.half_size[1]
        if _beyond_side(origin[0], offset_other[0], extent_x, half[0]):
            continue
        if _beyond_side(origin[1], offset_other[1], extent_y, half[1]):
            continue
        for index in range(num_points):
            if (seen & (1 << index)) == 0:
                continue
            ray = wp.vec3(rays[index, 0], rays[index, 1], rays[index, 2])
            direction = rotate_yaw_inverse(ray, cos_yaw, sin_yaw)
            hit = float(0.0)
            if obstacles.is_cylinder[other]:
                hit = ray_cylinder(origin, direction, half[0], half[2])
            else:
                hit = ray_box(origin, direction, half)
            if hit < 1.0:
                seen = seen & ~(1 << index)
    return seen
