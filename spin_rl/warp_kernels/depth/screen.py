# pyright: reportGeneralTypeIssues=false, reportCallIssue=false, reportOperatorIssue=false
# pyright: reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Where a solid in the optical frame can be in the image."""

import warp as wp

# What is nearer than this is not projected [m].
_NEAR_M = wp.constant(1.0e-5)
# Slack of rectangles, for rounding [pixels].
_SLACK = wp.constant(0.01)
# Farther than any projection at 1 m [m].
_FAR = wp.constant(1.0e9)

wp.set_module_options({"enable_backward": False})


@wp.struct
class Image:
    """Pixels and field of view; see ``render_depth``.

    Attributes:
        rows: Number of rows, along the optical x axis.
        columns: Number of columns, against the optical y axis.
        tan: Tangents of half the field of view along optical x and y.
        pitch: Distance of neighbouring pixels at a depth of 1 m, along optical x and y [m].
        inverse_max_range: 1 / largest depth [1/m].
    """

    rows: int
    columns: int
    tan: wp.vec2
    pitch: wp.vec2
    inverse_max_range: float


@wp.struct
class Body:
    """A solid in the optical frame.

    Attributes:
        centre: Centre [m].
        x: Its x axis; y and z alike.
        size: Half extents of the box around it [m].
    """

    centre: wp.vec3
    x: wp.vec3
    y: wp.vec3
    z: wp.vec3
    size: wp.vec3


def make_image(shape: tuple[int, int], tan_half_fov: tuple[float, float], max_range: float) -> Image:
    """Describe an image to the launchers.

    Row i and column j look along x = tan_x (2 (i + 0.5) / rows - 1), y = -tan_y (2 (j + 0.5) / columns - 1),
    z = 1 in the optical frame: through the centre of the pixel.

    Args:
        shape: Rows and columns.
        tan_half_fov: Tangents of half the field of view along optical x and y.
        max_range: Largest depth seen [m].
    """
    image = Image()
    image.rows, image.columns = shape
    image.tan = wp.vec2(*tan_half_fov)
    image.pitch = wp.vec2(*(2.0 * tan / count for tan, count in zip(tan_half_fov, shape, strict=True)))
    image.inverse_max_range = 1.0 / max_range
    return image


@wp.func
def out_of_view(image: Image, centre: wp.vec3, radius: float) -> bool:
    """Whether a sphere lies behind the camera, beyond the largest depth, or beside the image."""
    x = wp.abs(centre[0]) - image.tan[0] * centre[2]
    y = wp.abs(centre[1]) - image.tan[1] * centre[2]
    return (
        centre[2] + radius < _NEAR_M
        or (centre[2] - radius) * image.inverse_max_range > 1.0
        or x > radius * wp.sqrt(1.0 + image.tan[0] * image.tan[0])
        or y > radius * wp.sqrt(1.0 + image.tan[1] * image.tan[1])
    )


@wp.func
def _corner(body: Body, index: int) -> wp.vec3:
    """Corner of the box around a body; bits 0 to 2 of the index are its sides."""
    x = wp.where((index & 1) != 0, body.size[0], -body.size[0])
    y = wp.where((index & 2) != 0, body.size[1], -body.size[1])
    z = wp.where((index & 4) != 0, body.size[2], -body.size[2])
    return body.centre + x * body.x + y * body.y + z * body.z


@wp.func
def _cover(extent: wp.vec4, point: wp.vec3) -> wp.vec4:
    """Extent (least and largest x, least and largest y, at 1 m) with a point's projection included."""
    scale = 1.0 / point[2]
    x = point[0] * scale
    y = point[1] * scale
    return wp.vec4(wp.min(extent[0], x), wp.max(extent[1], x), wp.min(extent[2], y), wp.max(extent[3], y))


@wp.func
def _extent_in_front(body: Body) -> wp.vec4:
    """Extent, as in ``_cover``, of the part in front of the camera of a box that reaches behind it."""
    extent = wp.vec4(_FAR, -_FAR, _FAR, -_FAR)
    edge = int(0)
    while edge < 12:
        # Four edges along each axis, from corners that have that axis' bit cleared.
        axis = edge // 4
        rest = edge % 4
        low = rest
        if axis == 0:
            low = rest << 1
        elif axis == 1:
            low = (rest & 1) | ((rest & 2) << 1)
        p = _corner(body, low)
        q = _corner(body, low | (1 << axis))
        if wp.max(p[2], q[2]) > _NEAR_M:
            if wp.min(p[2], q[2]) < _NEAR_M:
                cut = p + (q - p) * ((_NEAR_M - p[2]) / (q[2] - p[2]))
                cut[2] = _NEAR_M
                if p[2] < q[2]:
                    p = cut
                else:
                    q = cut
            extent = _cover(_cover(extent, p), q)
        edge += 1
    return extent


@wp.func
def rectangle(image: Image, body: Body) -> wp.vec4i:
    """Pixels (first row, end row, first column, end column) that the box around a body can cover."""
    extent = wp.vec4(_FAR, -_FAR, _FAR, -_FAR)
    reach = (
        wp.abs(body.x[2]) * body.size[0] + wp.abs(body.y[2]) * body.size[1] + wp.abs(body.z[2]) * body.size[2]
    )
    if body.centre[2] - reach > _NEAR_M:
        for index in range(8):
            extent = _cover(extent, _corner(body, index))
    else:
        extent = _extent_in_front(body)
    rows = float(image.rows)
    columns = float(image.columns)
    top = (extent[0] + image.tan[0]) / image.pitch[0] - 0.5 - _SLACK
    bottom = (extent[1] + image.tan[0]) / image.pitch[0] - 0.5 + _SLACK
    left = (image.tan[1] - extent[3]) / image.pitch[1] - 0.5 - _SLACK
    right = (image.tan[1] - extent[2]) / image.pitch[1] - 0.5 + _SLACK
    return wp.vec4i(
        int(wp.ceil(wp.clamp(top, 0.0, rows))),
        int(wp.floor(wp.clamp(bottom, -1.0, rows - 1.0))) + 1,
        int(wp.ceil(wp.clamp(left, 0.0, columns))),
        int(wp.floor(wp.clamp(right, -1.0, columns - 1.0))) + 1,
    )
