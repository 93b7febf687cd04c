# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportInvalidTypeForm=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Second stage of depth images: the records of the geoms in view, evaluated at the pixels.

On the CPU one thread draws a world's whole image, solid by solid, in vector instructions; on CUDA one thread
computes a pixel.
"""

import warp as wp

from spin_rl.warp_kernels.depth import shapes
from spin_rl.warp_kernels.depth.project import BOX, CAPSULE, CYLINDER, ELLIPSOID, PLANE
from spin_rl.warp_kernels.depth.records import DepthBuffers
from spin_rl.warp_kernels.depth.screen import Image

RECORD_SIZE = wp.constant(shapes.RECORD_SIZE)

wp.set_module_options({"enable_backward": False})


def draw_depth(
    buffers: DepthBuffers, mask: wp.array, *, image: Image, by_pixel: bool, depth_out: wp.array
) -> None:
    """Draw the masked worlds' images from the records; graph-safe.

    Args:
        buffers: Of `project_geoms`.
        mask: Worlds to draw, shape (nworld,), bool; images of the others are left alone.
        image: Of `make_image`.
        by_pixel: One thread a pixel, for CUDA; else one thread a world, for the CPU and images of at least
            ``depth_shapes.LANES`` columns. The images are the same but for rounding.
        depth_out: Output, z-depth [m], 0 where nothing is hit within the largest range, shape
            (nworld, rows, columns), contiguous.
    """
    wp.launch(
        _draw_pixels if by_pixel else _draw_worlds,
        dim=depth_out.shape if by_pixel else depth_out.shape[0],
        inputs=[
            buffers.num_shown,
            buffers.shown,
            buffers.kind,
            buffers.rect,
            buffers.lines,
            mask,
            image,
        ],
        outputs=[depth_out.flatten()],
        device=depth_out.device,
    )


@wp.kernel
def _draw_worlds(
    # In
    num_shown: wp.array(dtype=wp.int32),
    shown: wp.array2d(dtype=wp.int32),
    kind: wp.array2d(dtype=wp.int32),
    rect: wp.array2d(dtype=wp.vec4i),
    lines: wp.array(dtype=wp.vec3),
    mask: wp.array(dtype=bool),
    image: Image,
    # Out
    depth_out: wp.array(dtype=float),
) -> None:
    world = wp.tid()
    if not mask[world]:
        return
    columns = image.columns
    count = image.rows * columns
    begin = world * count
    shapes.clear_pixels(depth_out, begin, count)
    for index in range(num_shown[world]):
        slot = shown[world, index]
        what = kind[world, slot]
        where = rect[world, slot]
        first = (world * shown.shape[1] + slot) * RECORD_SIZE
        if what == PLANE:
            shapes.draw_plane(depth_out, begin, columns, where, lines, first)
        elif what == BOX:
            shapes.draw_box0(depth_out, begin, columns, where, lines, first)
        elif what == BOX + 1:
            shapes.draw_box1(depth_out, begin, columns, where, lines, first)
        elif what == BOX + 2:
            shapes.draw_box2(depth_out, begin, columns, where, lines, first)
        elif what == BOX + 3:
            shapes.draw_box3(depth_out, begin, columns, where, lines, first)
        elif what == ELLIPSOID:
            shapes.draw_ellipsoid(depth_out, begin, columns, where, lines, first)
        elif what == CYLINDER:
            shapes.draw_cylinder(depth_out, begin, columns, where, lines, first)
        elif what == CAPSULE:
            shapes.draw_capsule(depth_out, begin, columns, where, lines, first)
    shapes.pixels_to_depth(depth_out, begin, count, image.inverse_max_range)


@wp.func
def inverse_depth_at(kind: int, lines: wp.array[wp.vec3], first: int, row: float, column: float) -> float:
    """Inverse depth [1/m] of a solid at one pixel, at most 0 where it is not hit.

    Args:
        kind: Kind of its record.
        lines: Records of ``RECORD_SIZE`` vectors, flat.
        first: Where its record begins.
        row: Row of the pixel.
        column: Its column.
    """
    inverse = float(0.0)
    if kind == PLANE:
        inverse = shapes.plane_at(lines, first, row, column)
    elif kind == BOX:
        inverse = shapes.box0_at(lines, first, row, column)
    elif kind == BOX + 1:
        inverse = shapes.box1_at(lines, first, row, column)
    elif kind == BOX + 2:
        inverse = shapes.box2_at(lines, first, row, column)
    elif kind == BOX + 3:
        inverse = shapes.box3_at(lines, first, row, column)
    elif kind == ELLIPSOID:
        inverse = shapes.ellipsoid_at(lines, first, row, column)
    elif kind == CYLINDER:
        inverse = shapes.cylinder_at(lines, first, row, column)
    elif kind == CAPSULE:
        inverse = shapes.capsule_at(lines, first, row, column)
    return inverse


@wp.kernel
def _draw_pixels(
    # In
    num_shown: wp.array(dtype=wp.int32),
    shown: wp.array2d(dtype=wp.int32),
    kind: wp.array2d(dtype=wp.int32),
    rect: wp.array2d(dtype=wp.vec4i),
    lines: wp.array(dtype=wp.vec3),
    mask: wp.array(dtype=bool),
    image: Image,
    # Out
    depth_out: wp.array(dtype=float),
) -> None:
    world, row, column = wp.tid()
    if not mask[world]:
        return
    u = float(row)
    v = float(column)
    best = float(0.0)
    for index in range(num_shown[world]):
        slot = shown[world, index]
        where = rect[world, slot]
        if row < where[0] or row >= where[1] or column < where[2] or column >= where[3]:
            continue
        what = kind[world, slot]
        first = (world * shown.shape[1] + slot) * RECORD_SIZE
        inverse = inverse_depth_at(what, lines, first, u, v)
        best = wp.max(best, inverse)
    depth_out[(world * image.rows + row) * image.columns + column] = wp.where(
        best > image.inverse_max_range, 1.0 / best, 0.0
    )
