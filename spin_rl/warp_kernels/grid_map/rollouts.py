# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportCallIssue=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false, reportArgumentType=false
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false, reportReturnType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Short drives at constant speeds, weighed by the way left to the goal and the distance to what a scan shows.

That is the dynamic window approach (Fox, Burgard and Thrun 1997) with a navigation function in place of the
straight way to the goal (Brock and Khatib 1999).
"""

import warp as wp

from spin_rl.warp_kernels.distance_field.field import UNREACHABLE, Field, field_at
from spin_rl.warp_kernels.grid_map.frame import place

IMPOSSIBLE = wp.constant(1.0e6)
"""Cost of a drive that touches something."""

wp.set_module_options({"enable_backward": False})


@wp.struct
class Footprint:
    """The robot seen from above: a box in its own frame, ``low`` and ``high`` corners [m]."""

    low: wp.vec2
    high: wp.vec2


@wp.struct
class Weights:
    """How drives are weighed.

    ``time`` [s] is how long a drive is looked at, in ``steps`` pieces; ``ahead`` [m] is how far before the
    robot the way left is read as well as where it is; ``margin`` [m] is the least distance to obstacles,
    ``near`` [m] the distance from which they cost up to ``obstacle`` [m of way].
    """

    time: float
    steps: int
    ahead: float
    margin: float
    near: float
    obstacle: float


@wp.func
def _gap(footprint: Footprint, point: wp.vec2) -> float:
    """Distance of a point in the robot's frame to the robot; below 0 inside."""
    x = wp.max(footprint.low[0] - point[0], point[0] - footprint.high[0])
    y = wp.max(footprint.low[1] - point[1], point[1] - footprint.high[1])
    if x <= 0.0 or y <= 0.0:
        return wp.max(x, y)
    return wp.sqrt(x * x + y * y)


@wp.func
def _drive(speed: wp.vec2, time: float) -> wp.vec3:
    """Where a drive at constant speeds from the origin is after a time."""
    turned = speed[1] * time
    way = speed[0] * time
    middle = 0.5 * turned
    chord = way
    if wp.abs(middle) > 1.0e-4:
        chord = way * wp.sin(middle) / middle
    return wp.vec3(chord * wp.cos(middle), chord * wp.sin(middle), turned)


@wp.func
def _least_gap(
    footprint: Footprint,
    world: int,
    at: wp.vec3,
    points: wp.array2d[wp.vec2],
    count: int,
    near: float,
) -> float:
    """Smallest distance of the robot at a pose to the points of a scan, at most ``near``."""
    least = float(near)
    c = wp.cos(at[2])
    s = wp.sin(at[2])
    for i in range(count):
        x = points[world, i][0] - at[0]
        y = points[world, i][1] - at[1]
        least = wp.min(least, _gap(footprint, wp.vec2(c * x + s * y, c * y - s * x)))
    return least


@wp.kernel
def _weigh(
    poses: wp.array[wp.vec3],
    field: Field,
    points: wp.array2d[wp.vec2],
    counts: wp.array[int],
    speeds: wp.array2d[wp.vec2],
    footprint: Footprint,
    weights: Weights,
    cost_out: wp.array2d[float],
    gap_out: wp.array2d[float],
):
    """Cost of a drive, one thread per world and drive."""
    world, i = wp.tid()
    speed = speeds[world, i]
    pose = poses[world]
    count = counts[world]
    now = _least_gap(footprint, world, wp.vec3(0.0, 0.0, 0.0), points, count, weights.near)
    # Whoever is too near already may drive where it does not get nearer.
    allowed = wp.min(weights.margin, now - 1.0e-3)
    least = float(weights.near)
    last = float(0.0)
    hit = bool(False)
    piece = weights.time / float(weights.steps)
    for step in range(weights.steps):
        if not hit:
            at = _drive(speed, piece * float(step + 1))
            last = _least_gap(footprint, world, at, points, count, weights.near)
            least = wp.min(least, last)
            hit = last < allowed
    gap_out[world, i] = last
    if hit:
        cost_out[world, i] = IMPOSSIBLE
        return
    end = _drive(speed, weights.time)
    here = place(pose, wp.vec2(end[0], end[1]))
    heading = pose[2] + end[2]
    front = here + weights.ahead * wp.vec2(wp.cos(heading), wp.sin(heading))
    way = field_at(field, world, here[0], here[1])
    beyond = field_at(field, world, front[0], front[1])
    # At the goal, what is beyond it counts no more.
    share = wp.min(way / wp.max(weights.ahead, 1.0e-6), 1.0)
    closeness = 1.0 - wp.max(least, 0.0) / weights.near
    # Beyond what is blocked, nothing is known: it is worse than turning back there.
    cost = wp.min(way, UNREACHABLE) + share * wp.min(beyond, way + 2.0 * weights.ahead)
    cost_out[world, i] = cost + weights.obstacle * closeness * closeness


def weigh_drives(
    poses: wp.array,
    field: Field,
    points: wp.array,
    counts: wp.array,
    speeds: wp.array,
    footprint: Footprint,
    weights: Weights,
    *,
    cost_out: wp.array,
    gap_out: wp.array,
) -> None:
    """Weigh every drive of every world.

    Args:
        poses: Base poses in the map (x [m], y [m], yaw [rad]), shape (nworld,), vec3.
        field: Ways left.
        points: Hits of the last scan in the base frame [m], shape (nworld, beams), vec2.
        counts: How many of them there are, shape (nworld,), int32.
        speeds: Forward [m/s] and turning [rad/s] speed of each drive, shape (nworld, drives), vec2.
        footprint: The robot.
        weights: How drives are weighed.
        cost_out: Output, `IMPOSSIBLE` or metres, shape (nworld, drives).
        gap_out: Output, distance to the nearest hit at its end, at most `weights.near` [m], likewise.
    """
    wp.launch(
        _weigh,
        dim=speeds.shape,
        inputs=[poses, field, points, counts, speeds, footprint, weights],
        outputs=[cost_out, gap_out],
        device=speeds.device,
    )
