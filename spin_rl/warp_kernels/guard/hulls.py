# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportInvalidTypeForm=false
# pyright: reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportIndexIssue=false, reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""The robot as four upright boxes that turn with the base: the base itself, mast and head, arm, hand."""

import warp as wp

NUM_HULLS = wp.constant(4)
"""Base; mast and head; arm; wrist and gripper."""
FIRST_ARM_HULL = wp.constant(2)

_Corners = wp.types.matrix(shape=(4, 3), dtype=wp.float32)

wp.set_module_options({"enable_backward": False})


@wp.struct
class Shapes:
    """The robot's collision geoms; arrays (nshape,). ``hull`` is the box that a geom is in.

    ``half_size`` are half extents of a box, or (0, 0, half length) of a capsule, which has a ``radius`` [m].
    """

    geom: wp.array[int]
    hull: wp.array[int]
    half_size: wp.array[wp.vec3]
    radius: wp.array[float]


@wp.struct
class Hulls:
    """Lowest and highest corners of the robot's boxes in the base frame [m]."""

    low: _Corners
    high: _Corners


@wp.func
def hulls_of(world: int, low: wp.array2d[wp.vec3], high: wp.array2d[wp.vec3]) -> Hulls:
    """Read a world's boxes."""
    hulls = Hulls()
    for hull in range(NUM_HULLS):
        for axis in range(3):
            hulls.low[hull, axis] = low[world, hull][axis]
            hulls.high[hull, axis] = high[world, hull][axis]
    return hulls


@wp.func
def middle_of(hulls: Hulls, hull: int) -> wp.vec2:
    """Centre of a box on the floor."""
    return wp.vec2(
        0.5 * (hulls.low[hull, 0] + hulls.high[hull, 0]), 0.5 * (hulls.low[hull, 1] + hulls.high[hull, 1])
    )


@wp.func
def half_of(hulls: Hulls, hull: int) -> wp.vec2:
    """Half extents of a box on the floor."""
    return wp.vec2(
        0.5 * (hulls.high[hull, 0] - hulls.low[hull, 0]), 0.5 * (hulls.high[hull, 1] - hulls.low[hull, 1])
    )


@wp.func
def in_base(vector: wp.vec3, yaw: float) -> wp.vec3:
    """Turn a vector from the world into the frame of a base with this yaw [rad]."""
    cos_yaw = wp.cos(yaw)
    sin_yaw = wp.sin(yaw)
    return wp.vec3(
        cos_yaw * vector[0] + sin_yaw * vector[1], cos_yaw * vector[1] - sin_yaw * vector[0], vector[2]
    )


@wp.func
def reach_of(shapes: Shapes, i: int, frame: wp.mat33, yaw: float) -> wp.vec3:
    """How far a geom reaches from its centre along the axes of the base [m]."""
    half = shapes.half_size[i]
    reach = wp.vec3(shapes.radius[i], shapes.radius[i], shapes.radius[i])
    for axis in range(3):
        along = in_base(wp.vec3(frame[0, axis], frame[1, axis], frame[2, axis]), yaw)
        reach += half[axis] * wp.vec3(wp.abs(along[0]), wp.abs(along[1]), wp.abs(along[2]))
    return reach


@wp.kernel
def _measure_hulls(
    shapes: Shapes,
    geom_xpos: wp.array2d[wp.vec3],
    geom_xmat: wp.array2d[wp.mat33],
    qpos: wp.array2d[float],
    low_out: wp.array2d[wp.vec3],
    high_out: wp.array2d[wp.vec3],
):
    """The boxes around the robot's geoms, in the base frame."""
    world = wp.tid()
    base = wp.vec3(qpos[world, 0], qpos[world, 1], 0.0)
    yaw = qpos[world, 2]
    for hull in range(NUM_HULLS):
        low_out[world, hull] = wp.vec3(10.0, 10.0, 10.0)
        high_out[world, hull] = wp.vec3(-10.0, -10.0, -10.0)
    for i in range(shapes.geom.shape[0]):
        geom = shapes.geom[i]
        centre = in_base(geom_xpos[world, geom] - base, yaw)
        reach = reach_of(shapes, i, geom_xmat[world, geom], yaw)
        hull = shapes.hull[i]
        low_out[world, hull] = wp.min(low_out[world, hull], centre - reach)
        high_out[world, hull] = wp.max(high_out[world, hull], centre + reach)


def measure_hulls(
    shapes: Shapes,
    geom_xpos: wp.array,
    geom_xmat: wp.array,
    qpos: wp.array,
    low_out: wp.array,
    high_out: wp.array,
) -> None:
    """Measure the boxes around the robot's geoms; graph-safe.

    Args:
        shapes: The robot's collision geoms.
        geom_xpos: Positions of all geoms in the world [m], shape (nworld, ngeom), vec3.
        geom_xmat: Their frames, shape (nworld, ngeom), mat33.
        qpos: Joint positions, shape (nworld, nq).
        low_out: Output, lowest corners in the base frame [m], shape (nworld, NUM_HULLS), vec3.
        high_out: Output, highest corners, likewise.
    """
    wp.launch(
        _measure_hulls,
        dim=qpos.shape[0],
        inputs=[shapes, geom_xpos, geom_xmat, qpos],
        outputs=[low_out, high_out],
        device=qpos.device,
    )
