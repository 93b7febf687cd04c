# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""First stage of depth images: each geom in view becomes a record and a rectangle of pixels."""

from dataclasses import dataclass

import warp as wp

from spin_rl.warp_kernels.depth import shapes as depth_shapes
from spin_rl.warp_kernels.depth.project import PLANE, bounds, write_floor, write_record
from spin_rl.warp_kernels.depth.screen import Body, Image, out_of_view, rectangle

RECORD_SIZE = wp.constant(depth_shapes.RECORD_SIZE)

wp.set_module_options({"enable_backward": False})


@dataclass
class DepthBuffers:
    """What a frame needs beside the image; allocated once.

    Attributes:
        camera_pos: Camera positions [m], shape (nworld,), vec3.
        to_camera: World-to-camera rotations, shape (nworld,), mat33.
        num_shown: Geoms in view, shape (nworld,), int32.
        shown: Their slots, in any order, shape (nworld, nslot), int32.
        kind: Kinds of the records, shape (nworld, nslot), int32.
        rect: First row, end row, first column, end column of each, shape (nworld, nslot), vec4i.
        lines: Records, shape (nworld * nslot * RECORD_SIZE,), vec3.
    """

    camera_pos: wp.array
    to_camera: wp.array
    num_shown: wp.array
    shown: wp.array
    kind: wp.array
    rect: wp.array
    lines: wp.array

    @classmethod
    def create(cls, nworld: int, nslot: int, device: str) -> "DepthBuffers":
        """Allocate for a number of worlds and of geoms to draw in each."""
        with wp.ScopedDevice(device):
            return cls(
                camera_pos=wp.zeros(nworld, dtype=wp.vec3),
                to_camera=wp.zeros(nworld, dtype=wp.mat33),
                num_shown=wp.zeros(nworld, dtype=wp.int32),
                shown=wp.zeros((nworld, nslot), dtype=wp.int32),
                kind=wp.zeros((nworld, nslot), dtype=wp.int32),
                rect=wp.zeros((nworld, nslot), dtype=wp.vec4i),
                lines=wp.zeros(nworld * nslot * depth_shapes.RECORD_SIZE, dtype=wp.vec3),
            )


def project_geoms(
    geom_xpos: wp.array,
    geom_xmat: wp.array,
    geom_size: wp.array,
    geom_type: wp.array,
    geoms: wp.array,
    site_xpos: wp.array,
    site_xmat: wp.array,
    mount_pos: wp.array,
    mount_rot: wp.array,
    mask: wp.array,
    *,
    camera_site: int,
    image: Image,
    buffers_out: DepthBuffers,
) -> None:
    """Write the records of the geoms in view of the masked worlds' cameras; graph-safe.

    Args:
        geom_xpos: ``Data.geom_xpos`` [m], shape (nworld, ngeom), vec3.
        geom_xmat: ``Data.geom_xmat``, shape (nworld, ngeom), mat33.
        geom_size: ``Model.geom_size`` [m], shape (nworld or 1, ngeom), vec3.
        geom_type: ``Model.geom_type``, shape (ngeom,), int32: kinds of ``depth_project``.
        geoms: Geoms to draw, shape (nslot,), int32.
        site_xpos: ``Data.site_xpos`` [m], shape (nworld, nsite), vec3.
        site_xmat: ``Data.site_xmat``, shape (nworld, nsite), mat33.
        mount_pos: Shift of the camera in the site's frame [m], shape (nworld,), vec3.
        mount_rot: Rotation from the camera's frame to the site's, shape (nworld,), mat33.
        mask: Worlds to look at, shape (nworld,), bool.
        camera_site: Site of the camera's optical frame, z forward.
        image: Of `make_image`.
        buffers_out: Output, for as many worlds and geoms.
    """
    nworld = geom_xpos.shape[0]
    device = geom_xpos.device
    wp.launch(
        _place_cameras,
        dim=nworld,
        inputs=[site_xpos, site_xmat, mount_pos, mount_rot, mask, camera_site],
        outputs=[buffers_out.camera_pos, buffers_out.to_camera, buffers_out.num_shown],
        device=device,
    )
    wp.launch(
        _project_geoms,
        dim=(nworld, geoms.shape[0]),
        inputs=[
            geom_xpos,
            geom_xmat,
            geom_size,
            geom_type,
            geoms,
            buffers_out.camera_pos,
            buffers_out.to_camera,
            mask,
            image,
        ],
        outputs=[
            buffers_out.num_shown,
            buffers_out.shown,
            buffers_out.kind,
            buffers_out.rect,
            buffers_out.lines,
        ],
        device=device,
    )


@wp.kernel
def _place_cameras(
    # In
    site_xpos: wp.array2d(dtype=wp.vec3),
    site_xmat: wp.array2d(dtype=wp.mat33),
    mount_pos: wp.array(dtype=wp.vec3),
    mount_rot: wp.array(dtype=wp.mat33),
    mask: wp.array(dtype=bool),
    site: int,
    # Out
    camera_pos_out: wp.array(dtype=wp.vec3),
    to_camera_out: wp.array(dtype=wp.mat33),
    num_shown_out: wp.array(dtype=wp.int32),
) -> None:
    world = wp.tid()
    if not mask[world]:
        return
    to_world = site_xmat[world, site]
    camera_pos_out[world] = site_xpos[world, site] + to_world * mount_pos[world]
    to_camera_out[world] = wp.transpose(to_world * mount_rot[world])
    num_shown_out[world] = 0


@wp.kernel
def _project_geoms(
    # In
    geom_xpos: wp.array2d(dtype=wp.vec3),
    geom_xmat: wp.array2d(dtype=wp.mat33),
    geom_size: wp.array2d(dtype=wp.vec3),
    geom_type: wp.array(dtype=wp.int32),
    geoms: wp.array(dtype=wp.int32),
    camera_pos: wp.array(dtype=wp.vec3),
    to_camera: wp.array(dtype=wp.mat33),
    mask: wp.array(dtype=bool),
    image: Image,
    # Out
    num_shown_out: wp.array(dtype=wp.int32),
    shown_out: wp.array2d(dtype=wp.int32),
    kind_out: wp.array2d(dtype=wp.int32),
    rect_out: wp.array2d(dtype=wp.vec4i),
    lines_out: wp.array(dtype=wp.vec3),
) -> None:
    world, slot = wp.tid()
    if not mask[world]:
        return
    geom = geoms[slot]
    kind = geom_type[geom]
    size = geom_size[world % geom_size.shape[0], geom]
    first = (world * geoms.shape[0] + slot) * RECORD_SIZE
    turn = to_camera[world]
    body = Body()
    body.centre = turn * (geom_xpos[world, geom] - camera_pos[world])
    body.size = bounds(kind, size)
    rect = wp.vec4i(0, image.rows, 0, image.columns)
    if kind != PLANE:
        if out_of_view(image, body.centre, wp.length(body.size)):
            return
    axes = turn * geom_xmat[world, geom]
    body.x = wp.vec3(axes[0, 0], axes[1, 0], axes[2, 0])
    body.y = wp.vec3(axes[0, 1], axes[1, 1], axes[2, 1])
    body.z = wp.vec3(axes[0, 2], axes[1, 2], axes[2, 2])
    if kind == PLANE:
        kind = write_floor(image, body, size, lines_out, first)
        if kind < 0:
            return
    else:
        rect = rectangle(image, body)
        if rect[0] >= rect[1] or rect[2] >= rect[3]:
            return
        kind = write_record(image, kind, body, size, lines_out, first)
    kind_out[world, slot] = kind
    rect_out[world, slot] = rect
    # The order differs from run to run on CUDA; the image does not depend on it.
    shown_out[world, wp.atomic_add(num_shown_out, world, 1)] = slot
