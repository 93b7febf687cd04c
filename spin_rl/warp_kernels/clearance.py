# pyright: reportGeneralTypeIssues=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""How near the robot's collision shapes are to walls and obstacles, and how fast the near ones move."""

import warp as wp

from spin_rl.warp_kernels.geometry import rotate_yaw_inverse
from spin_rl.warp_kernels.slots import Slots

_HALVINGS = 10
"""Steps of the search along a segment: its nearest point is found to a 2048th of the segment."""

_NO_BOUND = wp.constant(1.0e3)
"""More than any height [m]."""

wp.set_module_options({"enable_backward": False})


@wp.struct
class Shapes:
    """The robot's collision geoms, alike in all worlds; arrays of shape (nshape,).

    ``geom`` and ``body`` are indices of the model. A capsule has its radius and a ``half_size`` of (0, 0,
    half length); a box, which must stay upright, has its half extents and radius 0. ``reach`` is how far a
    shape extends from its centre horizontally and vertically at most [m].
    """

    geom: wp.array[int]
    body: wp.array[int]
    is_box: wp.array[wp.bool]
    half_size: wp.array[wp.vec3]
    radius: wp.array[float]
    reach: wp.array[wp.vec2]


@wp.struct
class BodyMotion:
    """Poses and velocities of one time, as in MuJoCo Warp's ``Data``."""

    geom_xpos: wp.array2d[wp.vec3]
    geom_xmat: wp.array2d[wp.mat33]
    cvel: wp.array2d[wp.spatial_vector]
    subtree_com: wp.array2d[wp.vec3]
    root: int


@wp.struct
class Slot:
    """One obstacle slot; shapes are brought into its frame."""

    centre: wp.vec3
    cos_yaw: float
    sin_yaw: float
    half_size: wp.vec3
    is_cylinder: bool


@wp.func
def _outside(slot: Slot, point: wp.vec3, half_height: float) -> wp.vec3:
    """Vector to a point from the nearest point of a slot that is made taller by ``half_height`` either way.

    Point and vector are in the slot's frame; zero for a point inside.
    """
    half = slot.half_size
    over = wp.max(wp.abs(point[2]) - half[2] - half_height, 0.0) * wp.sign(point[2])
    if slot.is_cylinder:
        distance = wp.sqrt(point[0] * point[0] + point[1] * point[1])
        share = wp.max(distance - half[0], 0.0) / wp.max(distance, 1.0e-6)
        return wp.vec3(share * point[0], share * point[1], over)
    return wp.vec3(
        wp.max(wp.abs(point[0]) - half[0], 0.0) * wp.sign(point[0]),
        wp.max(wp.abs(point[1]) - half[1], 0.0) * wp.sign(point[1]),
        over,
    )


@wp.func
def _segment_distance(slot: Slot, start_w: wp.vec3, end_w: wp.vec3, half_height: float) -> float:
    """Distance [m] of a slot to a segment that extends by ``half_height`` up and down; 0 inside.

    The distance to a convex body is a convex function along the segment. Half the derivative of its square is
    the vector from the body times the direction: its sign tells on which side the nearest point lies.
    """
    start = rotate_yaw_inverse(start_w - slot.centre, slot.cos_yaw, slot.sin_yaw)
    along = rotate_yaw_inverse(end_w - start_w, slot.cos_yaw, slot.sin_yaw)
    low = float(0.0)
    high = float(1.0)
    if wp.dot(_outside(slot, start, half_height), along) >= 0.0:
        high = 0.0
    elif wp.dot(_outside(slot, start + along, half_height), along) <= 0.0:
        low = 1.0
    else:
        for _ in range(wp.static(_HALVINGS)):
            middle = 0.5 * (low + high)
            if wp.dot(_outside(slot, start + middle * along, half_height), along) > 0.0:
                high = middle
            else:
                low = middle
    return wp.length(_outside(slot, start + 0.5 * (low + high) * along, half_height))


@wp.func
def _box_distance(slot: Slot, centre: wp.vec3, frame: wp.mat33, half: wp.vec3) -> float:
    """Distance [m] of a slot to an upright box: to its four sides, or from above or below between them."""
    across = wp.transpose(frame) * (slot.centre - centre)
    if wp.abs(across[0]) < half[0] and wp.abs(across[1]) < half[1]:
        return wp.max(wp.abs(across[2]) - half[2] - slot.half_size[2], 0.0)
    x = half[0] * wp.vec3(frame[0, 0], frame[1, 0], frame[2, 0])
    y = half[1] * wp.vec3(frame[0, 1], frame[1, 1], frame[2, 1])
    distance = _segment_distance(slot, centre - x - y, centre + x - y, half[2])
    distance = wp.min(distance, _segment_distance(slot, centre + x - y, centre + x + y, half[2]))
    distance = wp.min(distance, _segment_distance(slot, centre + x + y, centre - x + y, half[2]))
    return wp.min(distance, _segment_distance(slot, centre - x + y, centre - x - y, half[2]))


@wp.func
def _speed_squared(twist: wp.spatial_vector, from_com: wp.vec3) -> float:
    """Squared speed [m^2/s^2] of a point of a body; MuJoCo's spatial vectors have the rotation first."""
    velocity = wp.spatial_bottom(twist) + wp.cross(wp.spatial_top(twist), from_com)
    return wp.length_sq(velocity)


@wp.func
def _is_near(slot: Slot, centre: wp.vec3, reach: wp.vec2, limit: float) -> bool:
    """Whether anything that extends by ``reach`` around a point can be nearer to a slot than ``limit``."""
    offset = _outside(slot, rotate_yaw_inverse(centre - slot.centre, slot.cos_yaw, slot.sin_yaw), 0.0)
    across = reach[0] + limit
    is_near = offset[0] * offset[0] + offset[1] * offset[1] < across * across
    return is_near and wp.abs(offset[2]) < reach[1] + limit


@wp.func
def _robot_reach(shapes: Shapes, motion: BodyMotion, world: int) -> float:
    """How far the robot extends horizontally from the centre of its first shape [m]."""
    middle = motion.geom_xpos[world, shapes.geom[0]]
    farthest = float(0.0)
    for i in range(shapes.geom.shape[0]):
        offset = motion.geom_xpos[world, shapes.geom[i]] - middle
        distance = wp.sqrt(offset[0] * offset[0] + offset[1] * offset[1])
        farthest = wp.max(farthest, distance + shapes.reach[i][0])
    return farthest


@wp.func
def _measure_shape(
    i: int, shapes: Shapes, motion: BodyMotion, slot: Slot, world: int, limit: float, best: wp.vec2
) -> wp.vec2:
    """Lower the smallest distance, and raise the largest haste, by those of one shape and one slot."""
    centre = motion.geom_xpos[world, shapes.geom[i]]
    frame = motion.geom_xmat[world, shapes.geom[i]]
    half = shapes.half_size[i]
    end = frame * wp.vec3(half[0], half[1], 0.0)
    other = frame * wp.vec3(half[0], -half[1], 0.0)
    distance = float(0.0)
    if shapes.is_box[i]:
        distance = _box_distance(slot, centre, frame, half)
    else:
        end = frame * half
        other = end
        distance = wp.max(_segment_distance(slot, centre - end, centre + end, 0.0) - shapes.radius[i], 0.0)
    if distance >= limit:
        return best
    twist = motion.cvel[world, shapes.body[i]]
    from_com = centre - motion.subtree_com[world, motion.root]
    speed = wp.max(_speed_squared(twist, from_com + end), _speed_squared(twist, from_com - end))
    speed = wp.max(speed, _speed_squared(twist, from_com + other))
    speed = wp.max(speed, _speed_squared(twist, from_com - other))
    return wp.vec2(wp.min(best[0], distance), wp.max(best[1], speed * (1.0 - distance / limit)))


@wp.kernel
def _measure_clearance(
    shapes: Shapes,
    motion: BodyMotion,
    obstacles: Slots,
    limit: float,
    # Out
    clearance_out: wp.array[float],
    haste_out: wp.array[float],
):
    world = wp.tid()
    best = wp.vec2(limit, 0.0)
    middle = motion.geom_xpos[world, shapes.geom[0]]
    around = wp.vec2(_robot_reach(shapes, motion, world), _NO_BOUND)
    for j in range(obstacles.pos.shape[1]):
        if obstacles.active[world, j]:
            slot = Slot()
            slot.centre = obstacles.pos[world, j]
            slot.cos_yaw = wp.cos(obstacles.yaw[world, j])
            slot.sin_yaw = wp.sin(obstacles.yaw[world, j])
            slot.half_size = obstacles.half_size[world, j]
            slot.is_cylinder = obstacles.is_cylinder[j]
            if _is_near(slot, middle, around, limit):
                for i in range(shapes.geom.shape[0]):
                    if _is_near(slot, motion.geom_xpos[world, shapes.geom[i]], shapes.reach[i], limit):
                        best = _measure_shape(i, shapes, motion, slot, world, limit, best)
    clearance_out[world] = best[0]
    # A world whose state is not finite is reset; its reward shall be finite.
    haste_out[world] = wp.where(wp.isfinite(best[1]), best[1], 0.0)


def measure_clearance(
    shapes: Shapes,
    motion: BodyMotion,
    obstacles: Slots,
    *,
    limit: float,
    clearance_out: wp.array,
    haste_out: wp.array,
) -> None:
    """Measure every world's clearance; graph-safe.

    Distances are those of the collision geoms, up to the resolution of the search (0.2 mm for the Stretch's
    base, the longest shape but the mast); penetration reads as 0.

    Args:
        shapes: Collision geoms of the robot.
        motion: Poses and velocities.
        obstacles: Walls and obstacles; inactive slots do not count.
        limit: Distance from which nothing is near [m]; frozen when a graph is captured.
        clearance_out: Output, shape (nworld,): smallest distance of the robot to a slot [m], at most
            ``limit``.
        haste_out: Output, shape (nworld,) [m^2/s^2]: the largest of all shapes' squared speed times
            1 - distance / ``limit``; 0 where nothing is near. A shape's speed is that of the faster end of a
            capsule's axis, or of the fastest upright edge of a box.
    """
    wp.launch(
        _measure_clearance,
        dim=clearance_out.shape[0],
        inputs=[shapes, motion, obstacles, limit],
        outputs=[clearance_out, haste_out],
        device=clearance_out.device,
    )
