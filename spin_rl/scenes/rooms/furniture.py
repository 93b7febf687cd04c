# pyright: reportGeneralTypeIssues=false, reportCallIssue=false, reportOperatorIssue=false
# pyright: reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Pieces of furniture from boxes and cylinders, as Warp functions.

A piece has a frame on the floor, (x, y, yaw): x along it, y from its back to its front. It is drawn first,
with its footprint and the slots that it needs, and written once it has a place.
"""

import warp as wp

from spin_rl.scenes.rooms.geometry import ROBOT_TOP
from spin_rl.warp_kernels.slots import Slots, put_slot

TABLE = wp.constant(0)
CHAIR = wp.constant(1)
SHELF = wp.constant(2)
COUCH = wp.constant(3)
COUNTER = wp.constant(4)
CABINET = wp.constant(5)
WALL_SHELF = wp.constant(6)
LAMP = wp.constant(7)
PENDANT = wp.constant(8)
BEAM = wp.constant(9)
SMALL = wp.constant(10)

_CHAIR_DEPTH = wp.constant(0.3)
"""How far chairs stand out from their table."""

HANGING_SHARE = wp.constant(0.09)
"""Share of pendants and beams in `_KINDS`."""

vec11 = wp.types.vector(length=11, dtype=float)
# Cumulative shares of the kinds, and how often a piece of a kind stands with its back to a wall.
_KINDS = wp.constant(vec11(0.14, 0.27, 0.35, 0.42, 0.5, 0.58, 0.65, 0.7, 0.74, 0.79, 1.0))
_AT_WALL = wp.constant(vec11(0.2, 0.2, 0.9, 0.8, 0.9, 0.85, 1.0, 0.6, 0.0, 0.5, 0.3))

wp.set_module_options({"enable_backward": False})


@wp.struct
class Piece:
    """A piece before it has a place.

    ``half`` is its footprint, ``size`` what its kind makes of it, ``style`` a variant, ``foot`` radius and
    height of a chair's. ``above`` hangs higher
    than the robot.
    """

    kind: int
    half: wp.vec2
    size: wp.vec3
    foot: wp.vec2
    style: int
    chairs: int
    boxes: int
    cylinders: int
    at_wall: bool
    above: bool


@wp.func
def _draw_hanging(drawn: Piece, high: bool, u: float, v: float, thickness: wp.vec2) -> Piece:
    """Bottom and thickness of what hangs: at the height of head and mast, or above the robot."""
    piece = drawn
    bottom = wp.lerp(0.95, 1.38, u)
    if high:
        bottom = wp.lerp(ROBOT_TOP, 2.1, u)
    piece.size = wp.vec3(0.0, bottom, wp.lerp(thickness[0], thickness[1], v))
    piece.above = high
    return piece


@wp.func
def _with_share(u: float, hanging_share: float) -> float:
    """Stretch a uniform draw so that what hangs in the room gets another share than in `_KINDS`."""
    first = _KINDS[LAMP]
    share = _KINDS[BEAM] - first
    if hanging_share == HANGING_SHARE:
        return u
    scale = (1.0 - share) / (1.0 - hanging_share)
    if u * scale < first:
        return u * scale
    v = u - first / scale
    if v < hanging_share:
        return first + v * share / hanging_share
    return first + share + (v - hanging_share) * scale


@wp.func
def draw_piece(seed: int, index: int, hanging_share: float) -> Piece:
    """Draw kind and size of a piece."""
    state = wp.rand_init(seed, index)
    u = _with_share(wp.randf(state), hanging_share)
    at_wall = wp.randf(state)
    a = wp.randf(state)
    b = wp.randf(state)
    c = wp.randf(state)
    d = wp.randf(state)
    e = wp.randf(state)
    piece = Piece()
    kind = int(0)
    while kind < SMALL and u >= _KINDS[kind]:
        kind += 1
    piece.kind = kind
    piece.at_wall = at_wall < _AT_WALL[kind]
    piece.above = False
    piece.boxes = 1
    piece.cylinders = 0
    piece.chairs = 0
    piece.style = wp.min(int(3.0 * d), 2)
    if kind == TABLE:
        # Size: half length, height, half depth. Low ones have no chairs.
        piece.size = wp.vec3(wp.lerp(0.35, 0.9, a), wp.lerp(0.68, 0.78, c), wp.lerp(0.3, 0.5, b))
        if d < 0.25:
            piece.size = wp.vec3(wp.lerp(0.35, 0.6, a), wp.lerp(0.35, 0.5, c), wp.lerp(0.25, 0.35, b))
        elif not piece.at_wall:
            piece.chairs = wp.min(int(3.0 * e), 2)
        piece.style = 1
        piece.boxes = 5 + 3 * piece.chairs
        piece.half = wp.vec2(piece.size[0], piece.size[2])
        if piece.chairs > 0:
            piece.half = wp.vec2(piece.size[0], piece.size[2] + _CHAIR_DEPTH)
    elif kind == CHAIR:
        # Size: half width, height of the seat, height of the back.
        piece.size = wp.vec3(wp.lerp(0.19, 0.26, a), wp.lerp(0.42, 0.5, b), wp.lerp(0.8, 1.05, c))
        piece.half = wp.vec2(piece.size[0], piece.size[0])
        piece.boxes = 6
        if piece.style == 1:
            piece.boxes = 3
        if piece.style == 2:
            piece.boxes = 2
            piece.cylinders = 2
            # Its foot may be wider than the seat.
            foot = piece.size[0] * wp.lerp(0.8, 1.4, e)
            piece.half = wp.vec2(wp.max(foot, piece.size[0]), wp.max(foot, piece.size[0]))
            piece.foot = wp.vec2(foot, wp.lerp(0.03, 0.1, d))
    elif kind == SHELF:
        # Size: half width, height; closed or with open boards.
        piece.half = wp.vec2(wp.lerp(0.3, 0.7, a), wp.lerp(0.12, 0.2, b))
        piece.size = wp.vec3(piece.half[0], wp.lerp(0.8, 2.0, c), piece.half[1])
        if piece.style > 0:
            piece.boxes = 5
    elif kind == COUCH:
        # Size: half width, height of the seat, height of the back.
        piece.half = wp.vec2(wp.lerp(0.5, 1.1, a), wp.lerp(0.38, 0.48, b))
        piece.size = wp.vec3(piece.half[0], wp.lerp(0.38, 0.46, c), wp.lerp(0.7, 0.95, e))
        piece.boxes = 4
    elif kind == COUNTER:
        # Size: half width, height; two in three with cupboards above.
        piece.half = wp.vec2(wp.lerp(0.4, 1.3, a), wp.lerp(0.28, 0.34, b))
        piece.size = wp.vec3(piece.half[0], wp.lerp(0.82, 0.95, c), wp.lerp(1.25, 1.5, e))
        piece.boxes = 2
        if piece.style > 0 and piece.at_wall:
            piece.boxes = 3
    elif kind == CABINET:
        piece.half = wp.vec2(wp.lerp(0.2, 0.6, a), wp.lerp(0.18, 0.32, b))
        piece.size = wp.vec3(piece.half[0], wp.lerp(0.6, 2.1, c), 0.0)
    elif kind == WALL_SHELF:
        piece.half = wp.vec2(wp.lerp(0.2, 0.7, a), wp.lerp(0.08, 0.18, b))
        piece.size = wp.vec3(piece.half[0], wp.lerp(0.7, 1.35, c), wp.lerp(0.04, 0.4, e))
    elif kind == LAMP:
        # Size: radius of the shade, height of its bottom, radius of the foot.
        piece.size = wp.vec3(wp.lerp(0.1, 0.22, a), wp.lerp(1.2, 1.6, b), wp.lerp(0.1, 0.18, c))
        radius = wp.max(piece.size[0], piece.size[2])
        piece.half = wp.vec2(radius, radius)
        piece.boxes = 0
        piece.cylinders = 3
    elif kind == PENDANT:
        piece = _draw_hanging(piece, d < 0.5, b, c, wp.vec2(0.12, 0.3))
        radius = wp.lerp(0.1, 0.25, a)
        piece.half = wp.vec2(radius, radius)
        piece.boxes = 0
        piece.cylinders = 1
    elif kind == BEAM:
        piece = _draw_hanging(piece, d < 0.5, b, c, wp.vec2(0.08, 0.25))
        piece.half = wp.vec2(wp.lerp(0.05, 0.15, e), wp.lerp(0.3, 1.2, a))
    else:
        # Many are flat: what lies about, steps. One in three is a strip: a board, a rail, a cable cover.
        piece.half = wp.vec2(wp.lerp(0.03, 0.3, a * a), wp.lerp(0.03, 0.3, b * b))
        piece.size = wp.vec3(piece.half[0], wp.lerp(0.02, 0.4, c * c), 0.0)
        if piece.style == 0:
            piece.half = wp.vec2(piece.half[0], piece.half[0])
            piece.boxes = 0
            piece.cylinders = 1
        elif piece.style == 1:
            piece.half = wp.vec2(wp.lerp(0.2, 0.7, a), wp.lerp(0.015, 0.06, b))
    return piece


@wp.func
def _part(
    world: int, slot: int, frame: wp.vec3, x: float, y: float, z: wp.vec2, half: wp.vec2, slots: Slots
) -> None:
    """Write a box or cylinder of a piece: centre and half size in its frame, from z[0] to z[1]."""
    c = wp.cos(frame[2])
    s = wp.sin(frame[2])
    put_slot(
        world,
        slot,
        wp.vec3(frame[0] + c * x - s * y, frame[1] + s * x + c * y, 0.5 * (z[0] + z[1])),
        frame[2],
        wp.vec3(half[0], half[1], 0.5 * (z[1] - z[0])),
        slots,
    )


@wp.func
def _put_legs(
    world: int, box: int, frame: wp.vec3, half: wp.vec2, top: float, thick: float, slots: Slots
) -> None:
    for i in range(4):
        x = wp.where(i % 2 == 0, half[0] - thick, thick - half[0])
        y = wp.where(i < 2, half[1] - thick, thick - half[1])
        _part(world, box + i, frame, x, y, wp.vec2(0.0, top), wp.vec2(thick, thick), slots)


@wp.func
def _put_chair(
    world: int,
    box: int,
    cylinder: int,
    frame: wp.vec3,
    size: wp.vec3,
    style: int,
    foot: wp.vec2,
    slots: Slots,
) -> None:
    """Seat and back, on four legs (style 0), a block (1), or a pole with a foot (2)."""
    s = size[0]
    under = size[1] - 0.05
    _part(world, box, frame, 0.0, 0.0, wp.vec2(under, size[1]), wp.vec2(s, s), slots)
    _part(world, box + 1, frame, 0.0, 0.025 - s, wp.vec2(size[1], size[2]), wp.vec2(s, 0.025), slots)
    if style == 0:
        _put_legs(world, box + 2, frame, wp.vec2(s, s), under, 0.02, slots)
    elif style == 1:
        _part(world, box + 2, frame, 0.0, 0.0, wp.vec2(0.0, under), wp.vec2(0.8 * s, 0.8 * s), slots)
    else:
        _part(world, cylinder, frame, 0.0, 0.0, wp.vec2(foot[1], under), wp.vec2(0.03, 0.03), slots)
        _part(world, cylinder + 1, frame, 0.0, 0.0, wp.vec2(0.0, foot[1]), wp.vec2(foot[0], foot[0]), slots)


@wp.func
def _put_table(world: int, box: int, piece: Piece, frame: wp.vec3, slots: Slots) -> None:
    half = wp.vec2(piece.size[0], piece.size[2])
    top = piece.size[1]
    _part(world, box, frame, 0.0, 0.0, wp.vec2(top - 0.04, top), half, slots)
    _put_legs(world, box + 1, frame, half, top - 0.04, 0.03, slots)
    for i in range(piece.chairs):
        # Their fronts under the table, their backs outwards.
        side = wp.where(i == 0, -1.0, 1.0)
        y = side * (half[1] + _CHAIR_DEPTH - 0.21)
        c = wp.cos(frame[2])
        s = wp.sin(frame[2])
        chair = wp.vec3(frame[0] - s * y, frame[1] + c * y, frame[2] + wp.where(i == 0, 0.0, wp.pi))
        _put_chair(world, box + 5 + 3 * i, 0, chair, wp.vec3(0.21, 0.45, 0.9), 1, wp.vec2(), slots)


@wp.func
def _put_shelf(world: int, box: int, piece: Piece, frame: wp.vec3, slots: Slots) -> None:
    x = piece.half[0]
    y = piece.half[1]
    top = piece.size[1]
    if piece.boxes == 1:
        _part(world, box, frame, 0.0, 0.0, wp.vec2(0.0, top), piece.half, slots)
    else:
        _part(world, box, frame, 0.015 - x, 0.0, wp.vec2(0.0, top), wp.vec2(0.015, y), slots)
        _part(world, box + 1, frame, x - 0.015, 0.0, wp.vec2(0.0, top), wp.vec2(0.015, y), slots)
        for i in range(3):
            z = 0.08 + (top - 0.08) * float(i) / 2.0
            _part(world, box + 2 + i, frame, 0.0, 0.0, wp.vec2(z - 0.03, z), wp.vec2(x, y), slots)


@wp.func
def _put_couch(world: int, box: int, piece: Piece, frame: wp.vec3, slots: Slots) -> None:
    x = piece.half[0]
    y = piece.half[1]
    seat = piece.size[1]
    _part(world, box, frame, 0.0, 0.0, wp.vec2(0.0, seat), wp.vec2(x, y), slots)
    _part(world, box + 1, frame, 0.0, 0.1 - y, wp.vec2(seat, piece.size[2]), wp.vec2(x, 0.1), slots)
    for i in range(2):
        side = wp.where(i == 0, x - 0.08, 0.08 - x)
        _part(world, box + 2 + i, frame, side, 0.1, wp.vec2(seat, seat + 0.18), wp.vec2(0.08, y - 0.1), slots)


@wp.func
def _put_counter(world: int, box: int, piece: Piece, frame: wp.vec3, slots: Slots) -> None:
    x = piece.half[0]
    y = piece.half[1]
    top = piece.size[1]
    _part(world, box, frame, 0.0, -0.02, wp.vec2(0.0, top - 0.04), wp.vec2(x, y - 0.02), slots)
    _part(world, box + 1, frame, 0.0, 0.0, wp.vec2(top - 0.04, top), piece.half, slots)
    if piece.boxes == 3:
        cupboard = wp.vec2(piece.size[2], piece.size[2] + 0.6)
        _part(world, box + 2, frame, 0.0, -0.4 * y, cupboard, wp.vec2(x, 0.6 * y), slots)


@wp.func
def put_piece(world: int, box: int, cylinder: int, piece: Piece, frame: wp.vec3, slots: Slots) -> None:
    """Write a piece.

    Args:
        world: World to write.
        box: Slot of its first box; the others follow.
        cylinder: Slot of its first cylinder.
        piece: What.
        frame: Where: x, y [m] of its centre, yaw [rad].
        slots: Output.
    """
    if piece.kind == TABLE:
        _put_table(world, box, piece, frame, slots)
    elif piece.kind == CHAIR:
        _put_chair(world, box, cylinder, frame, piece.size, piece.style, piece.foot, slots)
    elif piece.kind == SHELF:
        _put_shelf(world, box, piece, frame, slots)
    elif piece.kind == COUCH:
        _put_couch(world, box, piece, frame, slots)
    elif piece.kind == COUNTER:
        _put_counter(world, box, piece, frame, slots)
    elif piece.kind == LAMP:
        shade = piece.size[1]
        pole = wp.vec2(0.03, shade)
        foot = wp.vec2(piece.size[2], piece.size[2])
        _part(world, cylinder, frame, 0.0, 0.0, wp.vec2(0.0, 0.03), foot, slots)
        _part(world, cylinder + 1, frame, 0.0, 0.0, pole, wp.vec2(0.015, 0.015), slots)
        around = wp.vec2(piece.size[0], piece.size[0])
        _part(world, cylinder + 2, frame, 0.0, 0.0, wp.vec2(shade, shade + 0.25), around, slots)
    else:
        # One body: a cabinet or a thing on the floor, or what hangs from size[1] up.
        z = wp.vec2(0.0, piece.size[1])
        if piece.kind == WALL_SHELF or piece.kind == PENDANT or piece.kind == BEAM:
            z = wp.vec2(piece.size[1], piece.size[1] + piece.size[2])
        slot = wp.where(piece.cylinders > 0, cylinder, box)
        _part(world, slot, frame, 0.0, 0.0, z, piece.half, slots)
