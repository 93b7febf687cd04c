# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportInvalidTypeForm=false
# pyright: reportCallIssue=false, reportIndexIssue=false, reportOperatorIssue=false, reportArgumentType=false
# pyright: reportAttributeAccessIssue=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Which pixels of a depth image show a target, a set of geoms that each world has, and where it then is.

A pixel shows the target if one of its geoms has the depth that the pixel has. So the records of a few geoms
are evaluated once more where they can be, and the image itself is drawn as if nothing were looked for.
"""

import warp as wp

from spin_rl.warp_kernels.depth import shapes as depth_shapes
from spin_rl.warp_kernels.depth.draw import inverse_depth_at
from spin_rl.warp_kernels.depth.records import DepthBuffers
from spin_rl.warp_kernels.depth.screen import Image

RECORD_SIZE = wp.constant(depth_shapes.RECORD_SIZE)

# Relative difference of two depths that are the same but for rounding: 0.1 mm at 1 m.
_SAME = wp.constant(1.0e-4)

wp.set_module_options({"enable_backward": False})


def find_targets(
    buffers: DepthBuffers,
    drawn: wp.array,
    depth: wp.array,
    measured: wp.array,
    targets: wp.array,
    mask: wp.array,
    *,
    image: Image,
    min_pixels: int,
    scratch: wp.array,
    slots_out: wp.array,
    num_pixels_out: wp.array,
    pixel_out: wp.array,
    box_out: wp.array,
    depth_out: wp.array,
    visible_out: wp.array,
) -> None:
    """Find the pixels that show the target of every masked world; graph-safe.

    Args:
        buffers: Of the images, see `project_geoms`.
        drawn: Geoms of the images, shape (nslot,), int32.
        depth: The images as `draw_depth` wrote them [m], shape (nworld, rows, columns), contiguous.
        measured: Images to take the target's depth from, 0 in holes, of the same shape; may be ``depth``.
        targets: Geoms of the targets, shape (nworld, ntarget), int32; less than 0 is none.
        mask: Worlds to look at, shape (nworld,), bool; what is known of the others is left alone.
        image: Of `make_image`.
        min_pixels: With fewer pixels the target is not visible.
        scratch: Working memory, shape (nworld, rows * columns), float.
        slots_out: Output, slots of the target in view, in any order, shape (nworld, ntarget), int32.
        num_pixels_out: Output, pixels that show the target, shape (nworld,), int32.
        pixel_out: Output, their mean row and column, 0 without any, shape (nworld,), vec2.
        box_out: Output, first row, end row, first column, end column of them, shape (nworld,), vec4i.
        depth_out: Output, median depth measured at them, of two middle ones the nearer, 0 if none of them was
            measured [m], shape (nworld,).
        visible_out: Output, whether there are enough pixels and a depth, shape (nworld,), bool.
    """
    wp.launch(
        _find_targets,
        dim=targets.shape[0],
        inputs=[
            buffers.num_shown,
            buffers.shown,
            buffers.kind,
            buffers.rect,
            buffers.lines,
            drawn,
            depth.flatten(),
            measured.flatten(),
            targets,
            mask,
            image,
            min_pixels,
            scratch,
        ],
        outputs=[slots_out, num_pixels_out, pixel_out, box_out, depth_out, visible_out],
        device=targets.device,
    )


def deproject_pixels(
    pixel: wp.array,
    depth: wp.array,
    known: wp.array,
    offset: wp.array,
    site_xpos: wp.array,
    site_xmat: wp.array,
    xpos: wp.array,
    xmat: wp.array,
    mask: wp.array,
    *,
    camera_site: int,
    base_body: int,
    image: Image,
    point_out: wp.array,
) -> None:
    """Turn a pixel and a depth of every masked world into a point in the base frame; graph-safe.

    Args:
        pixel: Row and column, whole numbers at the pixels' centres, shape (nworld,), vec2.
        depth: z-depth [m], shape (nworld,).
        known: Whether pixel and depth are known, shape (nworld,), bool.
        offset: How far behind that depth the point is, along the line of sight [m], shape (nworld,).
        site_xpos: ``Data.site_xpos`` [m], shape (nworld, nsite), vec3.
        site_xmat: ``Data.site_xmat``, shape (nworld, nsite), mat33.
        xpos: ``Data.xpos`` [m], shape (nworld, nbody), vec3.
        xmat: ``Data.xmat``, shape (nworld, nbody), mat33.
        mask: Worlds to compute, shape (nworld,), bool; the points of the others are left alone.
        camera_site: Site of the camera's optical frame, z forward.
        base_body: Body whose frame the points are in.
        image: Of `make_image`.
        point_out: Output, points in the base frame [m], 0 if unknown, shape (nworld,), vec3.
    """
    wp.launch(
        _deproject_pixels,
        dim=pixel.shape[0],
        inputs=[
            pixel,
            depth,
            known,
            offset,
            site_xpos,
            site_xmat,
            xpos,
            xmat,
            mask,
            camera_site,
            base_body,
            image,
        ],
        outputs=[point_out],
        device=pixel.device,
    )


@wp.func
def _is_target(targets: wp.array2d[wp.int32], world: int, geom: int) -> bool:
    for index in range(targets.shape[1]):
        if targets[world, index] == geom:
            return True
    return False


@wp.func
def _select(values: wp.array[float], begin: int, count: int, rank: int) -> float:
    """Value of a rank, from 0, among some values, whose order it changes (Hoare's selection)."""
    low = int(begin)
    high = int(begin + count - 1)
    wanted = begin + rank
    while low < high:
        pivot = values[(low + high) // 2]
        left = int(low)
        right = int(high)
        while left <= right:
            while values[left] < pivot:
                left += 1
            while values[right] > pivot:
                right -= 1
            if left <= right:
                kept = values[left]
                values[left] = values[right]
                values[right] = kept
                left += 1
                right -= 1
        if wanted <= right:
            high = right
        elif wanted >= left:
            low = left
        else:
            # Between the two parts everything equals the pivot.
            low = wanted
            high = wanted
    return float(values[wanted])


@wp.kernel
def _find_targets(
    # In
    num_shown: wp.array(dtype=wp.int32),
    shown: wp.array2d(dtype=wp.int32),
    kind: wp.array2d(dtype=wp.int32),
    rect: wp.array2d(dtype=wp.vec4i),
    lines: wp.array(dtype=wp.vec3),
    drawn: wp.array(dtype=wp.int32),
    depth: wp.array(dtype=float),
    measured: wp.array(dtype=float),
    targets: wp.array2d(dtype=wp.int32),
    mask: wp.array(dtype=bool),
    image: Image,
    min_pixels: int,
    # Working memory
    scratch: wp.array2d(dtype=float),
    # Out
    slots_out: wp.array2d(dtype=wp.int32),
    num_pixels_out: wp.array(dtype=wp.int32),
    pixel_out: wp.array(dtype=wp.vec2),
    box_out: wp.array(dtype=wp.vec4i),
    depth_out: wp.array(dtype=float),
    visible_out: wp.array(dtype=bool),
) -> None:
    world = wp.tid()
    if not mask[world]:
        return
    num_slots = int(0)
    search = wp.vec4i(image.rows, 0, image.columns, 0)
    for index in range(num_shown[world]):
        slot = shown[world, index]
        if num_slots < targets.shape[1] and _is_target(targets, world, drawn[slot]):
            slots_out[world, num_slots] = slot
            num_slots += 1
            search = _unite(search, rect[world, slot])
    num_pixels = int(0)
    num_measured = int(0)
    row_sum = int(0)
    column_sum = int(0)
    box = wp.vec4i(image.rows, 0, image.columns, 0)
    values = scratch[world]
    for row in range(search[0], search[1]):
        for column in range(search[2], search[3]):
            nearest = float(0.0)
            for index in range(num_slots):
                slot = slots_out[world, index]
                where = rect[world, slot]
                if row >= where[0] and row < where[1] and column >= where[2] and column < where[3]:
                    first = (world * shown.shape[1] + slot) * RECORD_SIZE
                    what = kind[world, slot]
                    nearest = wp.max(nearest, inverse_depth_at(what, lines, first, float(row), float(column)))
            at = (world * image.rows + row) * image.columns + column
            if nearest * depth[at] > 1.0 - _SAME:
                num_pixels += 1
                row_sum += row
                column_sum += column
                box = _unite(box, wp.vec4i(row, row + 1, column, column + 1))
                if measured[at] > 0.0:
                    values[num_measured] = measured[at]
                    num_measured += 1
    pixel = wp.vec2(0.0, 0.0)
    if num_pixels > 0:
        pixel = wp.vec2(float(row_sum), float(column_sum)) / float(num_pixels)
    else:
        box = wp.vec4i(0, 0, 0, 0)
    num_pixels_out[world] = num_pixels
    pixel_out[world] = pixel
    box_out[world] = box
    median = float(0.0)
    if num_measured > 0:
        median = _select(values, 0, num_measured, (num_measured - 1) // 2)
    depth_out[world] = median
    visible_out[world] = num_pixels >= min_pixels and num_measured > 0


@wp.func
def _unite(box: wp.vec4i, other: wp.vec4i) -> wp.vec4i:
    """The rectangle (first row, end row, first column, end column) around two."""
    return wp.vec4i(
        wp.min(box[0], other[0]),
        wp.max(box[1], other[1]),
        wp.min(box[2], other[2]),
        wp.max(box[3], other[3]),
    )


@wp.kernel
def _deproject_pixels(
    # In
    pixel: wp.array(dtype=wp.vec2),
    depth: wp.array(dtype=float),
    known: wp.array(dtype=bool),
    offset: wp.array(dtype=float),
    site_xpos: wp.array2d(dtype=wp.vec3),
    site_xmat: wp.array2d(dtype=wp.mat33),
    xpos: wp.array2d(dtype=wp.vec3),
    xmat: wp.array2d(dtype=wp.mat33),
    mask: wp.array(dtype=bool),
    site: int,
    body: int,
    image: Image,
    # Out
    point_out: wp.array(dtype=wp.vec3),
) -> None:
    world = wp.tid()
    if not mask[world]:
        return
    point = wp.vec3(0.0, 0.0, 0.0)
    if known[world]:
        ray = wp.vec3(
            (pixel[world][0] + 0.5) * image.pitch[0] - image.tan[0],
            image.tan[1] - (pixel[world][1] + 0.5) * image.pitch[1],
            1.0,
        )
        sight = site_xmat[world, site] * ((depth[world] + offset[world] / wp.length(ray)) * ray)
        point = wp.transpose(xmat[world, body]) * (site_xpos[world, site] + sight - xpos[world, body])
    point_out[world] = point
