# pyright: reportGeneralTypeIssues=false, reportCallIssue=false, reportOperatorIssue=false
# pyright: reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Places for pieces of furniture and single things: gaps that the robot fits through, or none."""

import warp as wp

from spin_rl.scenes.rooms.furniture import draw_piece, put_piece
from spin_rl.scenes.rooms.geometry import ROBOT_TOP, Site, rectangles_near
from spin_rl.scenes.rooms.struct import FamilyStruct
from spin_rl.warp_kernels.slots import Slots

TOUCH = wp.constant(0.02)
"""Pieces nearer to a wall than this touch it [m]."""

CLOSE = wp.constant(0.24)
"""Pieces may stand nearer to each other than this: no way leads through, also not past corners [m]."""

_TRIES = wp.constant(12)

wp.set_module_options({"enable_backward": False})


@wp.func
def _is_near(
    world: int, slot: int, centre: wp.vec2, yaw: float, half: wp.vec2, gap: float, slots: Slots
) -> bool:
    other = slots.pos[world, slot]
    size = slots.half_size[world, slot]
    return rectangles_near(
        centre,
        yaw,
        half,
        wp.vec2(other[0], other[1]),
        slots.yaw[world, slot],
        wp.vec2(size[0], size[1]),
        gap,
    )


@wp.func
def place_is_free(
    world: int,
    centre: wp.vec2,
    yaw: float,
    half: wp.vec2,
    gap: float,
    close: float,
    site: Site,
    slots: Slots,
) -> bool:
    """Whether a rectangle off the reserved floor leaves a gap to everything there, or touches walls.

    Or it is nearer than ``close``, if that is not 0: no gap is between the two.
    """
    for i in range(site.num_reserved):
        r = site.reserved[i]
        middle = wp.vec2(0.5 * (r[0] + r[2]), 0.5 * (r[1] + r[3]))
        if rectangles_near(
            centre, yaw, half, middle, 0.0, wp.vec2(0.5 * (r[2] - r[0]), 0.5 * (r[3] - r[1])), 0.0
        ):
            return False
    for slot in range(site.walls):
        if _is_near(world, slot, centre, yaw, half, gap, slots):
            if not _is_near(world, slot, centre, yaw, half, wp.max(close, TOUCH), slots):
                return False
    radius = wp.length(half)
    for i in range(site.boxes + site.cylinders):
        slot = site.first_box + i
        if i >= site.boxes:
            slot = site.first_cylinder + i - site.boxes
        other = slots.pos[world, slot]
        size = slots.half_size[world, slot]
        if other[2] - size[2] < ROBOT_TOP:
            reach = radius + gap + wp.length(wp.vec2(size[0], size[1]))
            dx = other[0] - centre[0]
            dy = other[1] - centre[1]
            if dx * dx + dy * dy < reach * reach:
                if _is_near(world, slot, centre, yaw, half, gap, slots):
                    if close == 0.0 or not _is_near(world, slot, centre, yaw, half, close, slots):
                        return False
    return True


@wp.func
def draw_close(q: FamilyStruct, u: float) -> float:
    """How near a piece may stand to others for a uniform number, 0 where it must leave a gap [m]."""
    return wp.where(u < q.close_share, CLOSE, 0.0)


@wp.func
def _snapped(s: float, half: float, length: float, gap: float) -> float:
    """A place along a wall, moved into the corner where the gap to it would be too narrow."""
    if s - half < gap:
        return half
    if length - s - half < gap:
        return length - half
    return s


@wp.func
def draw_frame(seed: int, index: int, half: wp.vec2, at_wall: bool, gap: float, r: wp.vec4) -> wp.vec4:
    """A random frame (x, y, yaw, 1) in a rectangle, back at a side or free within; zeros if none fits."""
    state = wp.rand_init(seed, index)
    width = r[2] - r[0]
    depth = r[3] - r[1]
    u = wp.randf(state)
    v = wp.randf(state)
    turn = wp.randf(state)
    side = wp.min(int(4.0 * wp.randf(state)), 3)
    if at_wall:
        length = wp.where(side % 2 == 0, width, depth)
        if 2.0 * half[0] > length or half[1] > 0.5 * wp.min(width, depth):
            return wp.vec4(0.0, 0.0, 0.0, 0.0)
        s = _snapped(wp.lerp(half[0], length - half[0], u), half[0], length, gap)
        if side == 0:
            return wp.vec4(r[0] + s, r[1] + half[1], 0.0, 1.0)
        if side == 1:
            return wp.vec4(r[2] - half[1], r[1] + s, 0.5 * wp.pi, 1.0)
        if side == 2:
            return wp.vec4(r[2] - s, r[3] - half[1], wp.pi, 1.0)
        return wp.vec4(r[0] + half[1], r[3] - s, -0.5 * wp.pi, 1.0)
    # Most things stand nearly square to the room.
    yaw = 0.5 * wp.pi * float(side) + 0.15 * (2.0 * turn - 1.0)
    if wp.randf(state) < 0.25:
        yaw = 2.0 * wp.pi * turn
    c = wp.abs(wp.cos(yaw))
    s = wp.abs(wp.sin(yaw))
    x = half[0] * c + half[1] * s + gap
    y = half[0] * s + half[1] * c + gap
    if 2.0 * x > width or 2.0 * y > depth:
        return wp.vec4(0.0, 0.0, 0.0, 0.0)
    return wp.vec4(wp.lerp(r[0] + x, r[2] - x, u), wp.lerp(r[1] + y, r[3] - y, v), yaw, 1.0)


@wp.func
def furnish(
    world: int,
    rectangle: int,
    density: float,
    q: FamilyStruct,
    seed: int,
    site: Site,
    slots: Slots,
) -> Site:
    """Put furniture into a rectangle of the site.

    Args:
        world: World to write.
        rectangle: Which.
        density: Pieces per square metre.
        q: Family parameters.
        seed: Seed of this rectangle.
        site: What there is so far.
        slots: Output.

    Returns:
        What there is now.
    """
    now = site
    r = site.rectangles[rectangle]
    count = int(density * (r[2] - r[0]) * (r[3] - r[1]) + 0.5)
    for k in range(count):
        piece = draw_piece(seed, k, q.furniture_hanging_share)
        fits = site.first_box + now.boxes + piece.boxes <= site.first_cylinder
        fits = fits and site.first_cylinder + now.cylinders + piece.cylinders <= site.num_slots
        placed = bool(False)
        if fits:
            gap = wp.where(piece.above, 0.0, q.gap)
            close = draw_close(q, wp.randf(wp.rand_init(seed + 2, k)))
            for attempt in range(_TRIES):
                if not placed:
                    frame = draw_frame(seed + 1, k * _TRIES + attempt, piece.half, piece.at_wall, gap, r)
                    placed = frame[3] > 0.0
                    if placed and not piece.above:
                        placed = place_is_free(
                            world,
                            wp.vec2(frame[0], frame[1]),
                            frame[2],
                            piece.half,
                            gap,
                            close,
                            now,
                            slots,
                        )
                    if placed:
                        put_piece(
                            world,
                            site.first_box + now.boxes,
                            site.first_cylinder + now.cylinders,
                            piece,
                            wp.vec3(frame[0], frame[1], frame[2]),
                            slots,
                        )
        if placed:
            now.boxes = now.boxes + piece.boxes
            now.cylinders = now.cylinders + piece.cylinders
            now.obstacles = now.obstacles + 1
    return now


@wp.func
def draw_density(q: FamilyStruct, u: float, v: float) -> float:
    """Pieces per square metre for two uniform numbers."""
    if u < q.furniture_empty_share:
        return 0.0
    return wp.lerp(q.furniture_density[0], q.furniture_density[1], v)
