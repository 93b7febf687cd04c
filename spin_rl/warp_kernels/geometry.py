# pyright: reportCallIssue=false, reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Geometry functions shared by the kernels: yaw frames, interval clipping, rays against boxes and cylinders.

Rays are ``origin + t * direction`` with t >= 0 and a direction of any length: t = 1 ends a segment.
Shapes are centred at the origin of their own frame.
"""

import warp as wp

MISS = wp.constant(1.0e10)
"""Ray parameter that means "never hits"."""

_TINY = wp.constant(1.0e-20)


@wp.func
def rotate_yaw(vector: wp.vec3, cos_yaw: float, sin_yaw: float) -> wp.vec3:
    """Turn a vector by a yaw about z (child frame to parent frame)."""
    return wp.vec3(
        cos_yaw * vector[0] - sin_yaw * vector[1], sin_yaw * vector[0] + cos_yaw * vector[1], vector[2]
    )


@wp.func
def rotate_yaw_inverse(vector: wp.vec3, cos_yaw: float, sin_yaw: float) -> wp.vec3:
    """Turn a vector back by a yaw about z (parent frame to child frame)."""
    return wp.vec3(
        cos_yaw * vector[0] + sin_yaw * vector[1], cos_yaw * vector[1] - sin_yaw * vector[0], vector[2]
    )


@wp.func
def clip_interval(interval: wp.vec2, value: float, slope: float) -> wp.vec2:
    """Part of ``interval`` (low, high) where ``value + slope * t >= 0``; low > high if none is left."""
    low = interval[0]
    high = interval[1]
    if wp.abs(slope) < _TINY:
        if value < 0.0:
            high = low - 1.0
    elif slope > 0.0:
        low = wp.max(low, -value / slope)
    else:
        high = wp.min(high, -value / slope)
    return wp.vec2(low, high)


@wp.func
def clip_slab(interval: wp.vec2, origin: float, direction: float, half: float) -> wp.vec2:
    """Part of ``interval`` where ``|origin + t * direction| <= half``; low > high means that none is left."""
    inverse = 1.0 / wp.where(wp.abs(direction) < _TINY, _TINY, direction)
    centre = -origin * inverse
    reach = half * wp.abs(inverse)
    return wp.vec2(wp.max(interval[0], centre - reach), wp.min(interval[1], centre + reach))


@wp.func
def ray_box(origin: wp.vec3, direction: wp.vec3, half_size: wp.vec3) -> float:
    """Smallest t >= 0 inside a solid box, or ``MISS``; 0 if the ray starts inside."""
    interval = clip_slab(wp.vec2(0.0, MISS), origin[0], direction[0], half_size[0])
    interval = clip_slab(interval, origin[1], direction[1], half_size[1])
    interval = clip_slab(interval, origin[2], direction[2], half_size[2])
    return wp.where(interval[0] <= interval[1], interval[0], MISS)


@wp.func
def ray_cylinder(origin: wp.vec3, direction: wp.vec3, radius: float, half_height: float) -> float:
    """Smallest t >= 0 inside a solid upright cylinder, or ``MISS``; 0 if the ray starts inside."""
    a = wp.max(direction[0] * direction[0] + direction[1] * direction[1], _TINY)
    b = origin[0] * direction[0] + origin[1] * direction[1]
    c = origin[0] * origin[0] + origin[1] * origin[1] - radius * radius
    discriminant = b * b - a * c
    if discriminant < 0.0:
        return MISS
    root = wp.sqrt(discriminant)
    interval = clip_slab(wp.vec2(0.0, MISS), origin[2], direction[2], half_height)
    low = wp.max(interval[0], (-b - root) / a)
    high = wp.min(interval[1], (-b + root) / a)
    return wp.where(low <= high, low, MISS)
