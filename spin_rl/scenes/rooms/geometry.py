# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportCallIssue=false
# pyright: reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Free floor as rectangles, and distances on it, as Warp functions."""

import warp as wp

from spin_rl.scenes.motion import Track
from spin_rl.scenes.rooms.params import HALF_SQUARE_M
from spin_rl.warp_kernels.slots import Slots

MAX_RECTANGLES = wp.constant(6)
ROBOT_TOP = wp.constant(1.45)
"""What hangs higher than this [m] is not in the robot's way: it is 1.42 m tall."""

HALF_OPEN = wp.constant(HALF_SQUARE_M - 0.4)
"""Half the side of the square for start and goal where there are no walls [m]."""

_BESIDE_MOVER = wp.constant(0.5)
"""What start and goal keep from where something moves [m]: the robot fits, arm stowed."""

Rectangles = wp.types.matrix(shape=(6, 4), dtype=float)
"""Rectangles along the axes, (low x, low y, high x, high y) each."""

wp.set_module_options({"enable_backward": False})


@wp.struct
class Site:
    """What a world has so far: floor to drive on, floor to keep free, and the slots taken.

    Slots are counted within their kind; ``obstacles`` are pieces of furniture, things and movers.
    """

    rectangles: Rectangles
    num_rectangles: int
    reserved: Rectangles
    num_reserved: int
    first_box: int
    first_cylinder: int
    num_slots: int
    walls: int
    boxes: int
    cylinders: int
    obstacles: int


@wp.func
def with_rectangle(site: Site, low_x: float, low_y: float, high_x: float, high_y: float) -> Site:
    """The site and one more rectangle to drive on."""
    grown = site
    rectangles = grown.rectangles
    rectangles[grown.num_rectangles] = wp.vec4(low_x, low_y, high_x, high_y)
    grown.rectangles = rectangles
    grown.num_rectangles = grown.num_rectangles + 1
    return grown


@wp.func
def with_reserved(site: Site, low_x: float, low_y: float, high_x: float, high_y: float) -> Site:
    """The site and one more rectangle in which nothing may be put."""
    grown = site
    reserved = grown.reserved
    reserved[grown.num_reserved] = wp.vec4(low_x, low_y, high_x, high_y)
    grown.reserved = reserved
    grown.num_reserved = grown.num_reserved + 1
    return grown


@wp.func
def middle_of(site: Site) -> wp.vec2:
    """Centre of the bounding rectangle of the floor [m]."""
    low = wp.vec2(1.0e6, 1.0e6)
    high = wp.vec2(-1.0e6, -1.0e6)
    for i in range(site.num_rectangles):
        r = site.rectangles[i]
        low = wp.min(low, wp.vec2(r[0], r[1]))
        high = wp.max(high, wp.vec2(r[2], r[3]))
    return 0.5 * (low + high)


@wp.func
def shifted(site: Site, by: wp.vec2) -> Site:
    """A site with nothing on it yet, its floor moved."""
    moved = site
    rectangles = moved.rectangles
    for i in range(site.num_rectangles):
        rectangles[i] = rectangles[i] + wp.vec4(by[0], by[1], by[0], by[1])
    moved.rectangles = rectangles
    return moved


@wp.func
def rectangles_near(
    a: wp.vec2, a_yaw: float, a_half: wp.vec2, b: wp.vec2, b_yaw: float, b_half: wp.vec2, gap: float
) -> bool:
    """Whether two turned rectangles are nearer than a gap; true for some a little farther at corners."""
    c = wp.cos(a_yaw)
    s = wp.sin(a_yaw)
    dx = b[0] - a[0]
    dy = b[1] - a[1]
    ct = wp.abs(wp.cos(b_yaw - a_yaw))
    st = wp.abs(wp.sin(b_yaw - a_yaw))
    if wp.abs(c * dx + s * dy) >= a_half[0] + gap + b_half[0] * ct + b_half[1] * st:
        return False
    if wp.abs(c * dy - s * dx) >= a_half[1] + gap + b_half[0] * st + b_half[1] * ct:
        return False
    c = wp.cos(b_yaw)
    s = wp.sin(b_yaw)
    if wp.abs(c * dx + s * dy) >= b_half[0] + gap + a_half[0] * ct + a_half[1] * st:
        return False
    return wp.abs(c * dy - s * dx) < b_half[1] + gap + a_half[0] * st + a_half[1] * ct


@wp.func
def slot_distance(world: int, slot: int, x: float, y: float, slots: Slots) -> float:
    """Distance on the floor from a point to a slot [m], 0 inside."""
    centre = slots.pos[world, slot]
    half = slots.half_size[world, slot]
    dx = x - centre[0]
    dy = y - centre[1]
    if slots.is_cylinder[slot]:
        return wp.max(wp.sqrt(dx * dx + dy * dy) - half[0], 0.0)
    c = wp.cos(slots.yaw[world, slot])
    s = wp.sin(slots.yaw[world, slot])
    ax = wp.max(wp.abs(c * dx + s * dy) - half[0], 0.0)
    ay = wp.max(wp.abs(c * dy - s * dx) - half[1], 0.0)
    return wp.sqrt(ax * ax + ay * ay)


@wp.func
def spot_clearance(world: int, x: float, y: float, most: float, slots: Slots) -> float:
    """Distance from a point to the nearest slot that a driving robot could hit [m], at most `most`."""
    nearest = float(most)
    for slot in range(slots.active.shape[1]):
        if slots.active[world, slot]:
            centre = slots.pos[world, slot]
            half = slots.half_size[world, slot]
            away = wp.length(wp.vec2(x - centre[0], y - centre[1])) - wp.length(wp.vec2(half[0], half[1]))
            if away < nearest and centre[2] - half[2] < ROBOT_TOP:
                nearest = wp.min(nearest, slot_distance(world, slot, x, y, slots))
    return nearest


@wp.func
def sweep_distance(x: float, y: float, home: wp.vec3, retreat: wp.vec2) -> float:
    """Distance from a point to the line along which a slot moves [m]."""
    dx = x - home[0]
    dy = y - home[1]
    t = wp.clamp((dx * retreat[0] + dy * retreat[1]) / wp.max(wp.length_sq(retreat), 1.0e-9), 0.0, 1.0)
    return wp.length(wp.vec2(dx - t * retreat[0], dy - t * retreat[1]))


@wp.func
def is_calm(world: int, x: float, y: float, slots: Slots, track: Track) -> bool:
    """Whether nothing that moves comes near a spot."""
    for slot in range(slots.active.shape[1]):
        if slots.active[world, slot] and track.speed[world, slot] > 0.0:
            half = slots.half_size[world, slot]
            away = sweep_distance(x, y, track.home[world, slot], track.retreat[world, slot])
            if away < _BESIDE_MOVER + wp.length(wp.vec2(half[0], half[1])):
                return False
    return True
