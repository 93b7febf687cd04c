# pyright: reportGeneralTypeIssues=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""From a geom's pose in the optical frame to the record that ``depth_shapes`` draws."""

import warp as wp

from spin_rl.warp_kernels.depth.screen import Body, Image

PLANE = wp.constant(0)
SPHERE = wp.constant(2)
CAPSULE = wp.constant(3)
ELLIPSOID = wp.constant(4)
CYLINDER = wp.constant(5)
BOX = wp.constant(6)
"""Kinds of geoms, numbered as in MuJoCo (``mjtGeom``). A box's record is of kind ``BOX + n``, where n counts
the faces that the camera is in front of, 0 from inside."""

# A division by less than this is one by this: the camera is then on a surface.
_TINY = wp.constant(1.0e-9)
# Half size of a rectangle's infinite side [m].
_ENDLESS_M = wp.constant(1.0e6)

wp.set_module_options({"enable_backward": False})


@wp.func
def _line(image: Image, normal: wp.vec3) -> wp.vec3:
    """Coefficients (a, b, c) with ``normal . r = a row + b column + c`` for the pixels' directions r."""
    a = normal[0] * image.pitch[0]
    b = -normal[1] * image.pitch[1]
    first_x = 0.5 * image.pitch[0] - image.tan[0]
    first_y = image.tan[1] - 0.5 * image.pitch[1]
    return wp.vec3(a, b, normal[0] * first_x + normal[1] * first_y + normal[2])


@wp.func
def _away_from_zero(value: float) -> float:
    return wp.where(wp.abs(value) < _TINY, wp.where(value < 0.0, -_TINY, _TINY), value)


@wp.func
def _slab(image: Image, axis: wp.vec3, centre: wp.vec3, half: float):
    """Lines of the face towards the camera and of the opposite one; whether the camera is in front."""
    origin = -wp.dot(axis, centre)
    side = wp.where(origin < 0.0, -1.0, 1.0)
    distance = wp.abs(origin) - half
    line = side * _line(image, axis)
    towards = line / -_away_from_zero(distance)
    away = line / -wp.max(wp.abs(origin) + half, _TINY)
    return towards, away, distance > 0.0


@wp.func
def _write_box(image: Image, body: Body, lines_out: wp.array[wp.vec3], first: int) -> int:
    """Write the six faces, those that the camera is in front of first; return the kind."""
    near = int(0)
    far = int(5)
    for axis in range(3):
        direction = body.x
        if axis == 1:
            direction = body.y
        elif axis == 2:
            direction = body.z
        towards, away, front = _slab(image, direction, body.centre, body.size[axis])
        lines_out[first + far] = away
        far -= 1
        if front:
            lines_out[first + near] = towards
            near += 1
        else:
            lines_out[first + far] = towards
            far -= 1
    return BOX + near


@wp.func
def _write_ellipsoid(
    image: Image, body: Body, centre: wp.vec3, radii: wp.vec3, lines_out: wp.array[wp.vec3], first: int
) -> wp.vec2:
    """Write the three lines of an ellipsoid with the body's axes; return its constants.

    In the frame where it is a unit sphere, turned so that the camera lies on the z axis: the quadratic in s
    has no mixed terms there, and its root is a difference of squares of lines.
    """
    p = -wp.vec3(
        wp.dot(body.x, centre) / radii[0],
        wp.dot(body.y, centre) / radii[1],
        wp.dot(body.z, centre) / radii[2],
    )
    distance = wp.length(p)
    axis = wp.where(distance > 1.0e-6, p / distance, wp.vec3(0.0, 0.0, 1.0))
    other = wp.where(wp.abs(axis[0]) < 0.6, wp.vec3(1.0, 0.0, 0.0), wp.vec3(0.0, 1.0, 0.0))
    across = wp.normalize(wp.cross(axis, other))
    third = wp.cross(axis, across)
    # Distance squared - 1, without its cancellation.
    power = _away_from_zero((distance - 1.0) * (distance + 1.0))
    scale = 1.0 / wp.sqrt(wp.abs(power))
    to_sphere = wp.transpose(wp.matrix_from_cols(body.x / radii[0], body.y / radii[1], body.z / radii[2]))
    back = wp.transpose(to_sphere)
    lines_out[first] = _line(image, scale * (back * across))
    lines_out[first + 1] = _line(image, scale * (back * third))
    lines_out[first + 2] = _line(image, (back * axis) / -power)
    return wp.vec2(distance, wp.sign(power))


@wp.func
def _write_tube(
    image: Image, body: Body, radius: float, half: float, lines_out: wp.array[wp.vec3], first: int
) -> wp.vec3:
    """Write the four lines of a cylinder along the body's z axis; return its constants."""
    px = -wp.dot(body.x, body.centre) / radius
    py = -wp.dot(body.y, body.centre) / radius
    distance = wp.sqrt(px * px + py * py)
    cos = wp.where(distance > 1.0e-6, px / distance, 1.0)
    sin = wp.where(distance > 1.0e-6, py / distance, 0.0)
    power = _away_from_zero((distance - 1.0) * (distance + 1.0))
    scale = 1.0 / (radius * wp.sqrt(wp.abs(power)))
    lines_out[first] = _line(image, (cos * body.x + sin * body.y) / (-power * radius))
    lines_out[first + 1] = _line(image, scale * (cos * body.y - sin * body.x))
    towards, away, front = _slab(image, body.z, body.centre, half)
    lines_out[first + 2] = towards
    lines_out[first + 3] = away
    return wp.vec3(distance, wp.sign(power), wp.where(front, 1.0, 0.0))


@wp.func
def write_record(
    image: Image, kind: int, body: Body, size: wp.vec3, lines_out: wp.array[wp.vec3], first: int
) -> int:
    """Write a solid's record; return its kind: a sphere is an ellipsoid, a box's counts the faces in front.

    Args:
        image: Pixels and field of view.
        kind: Any but ``PLANE``.
        body: Pose and half extents.
        size: As in MuJoCo: radius and half height of cylinders and capsules.
        lines_out: Output, records of ``RECORD_SIZE`` vectors, flat.
        first: Where the record begins.
    """
    if kind == BOX:
        return _write_box(image, body, lines_out, first)
    if kind == ELLIPSOID or kind == SPHERE:
        constants = _write_ellipsoid(image, body, body.centre, body.size, lines_out, first)
        lines_out[first + 3] = wp.vec3(constants[0], constants[1], 0.0)
        return ELLIPSOID
    if kind == CYLINDER:
        lines_out[first + 4] = _write_tube(image, body, size[0], size[1], lines_out, first)
    else:
        radii = wp.vec3(size[0], size[0], size[0])
        lines_out[first + 10] = _write_tube(image, body, size[0], size[1], lines_out, first)
        for end in range(2):
            centre = body.centre + (float(2 * end) - 1.0) * size[1] * body.z
            constants = _write_ellipsoid(image, body, centre, radii, lines_out, first + 4 + 3 * end)
            lines_out[first + 11 + end] = wp.vec3(constants[0], constants[1], 0.0)
    return kind


@wp.func
def write_floor(image: Image, body: Body, size: wp.vec3, lines_out: wp.array[wp.vec3], first: int) -> int:
    """Write a plane, seen from above only; return its kind, -1 if the camera is not above it.

    A plane with a finite side is a flat box, as in MuJoCo: a size of 0 is an infinite one.
    """
    height = -wp.dot(body.z, body.centre)
    if height <= 0.0:
        return -1
    if size[0] <= 0.0 and size[1] <= 0.0:
        lines_out[first] = _line(image, body.z) / -height
        return PLANE
    flat = body
    flat.size = wp.vec3(
        wp.where(size[0] > 0.0, size[0], _ENDLESS_M), wp.where(size[1] > 0.0, size[1], _ENDLESS_M), 0.0
    )
    return _write_box(image, flat, lines_out, first)


@wp.func
def bounds(kind: int, size: wp.vec3) -> wp.vec3:
    """Half extents of the box around a geom of a MuJoCo size."""
    if kind == SPHERE:
        return wp.vec3(size[0], size[0], size[0])
    if kind == CYLINDER:
        return wp.vec3(size[0], size[0], size[1])
    if kind == CAPSULE:
        return wp.vec3(size[0], size[0], size[1] + size[0])
    return size
