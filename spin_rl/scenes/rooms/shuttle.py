# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportOperatorIssue=false
# pyright: reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Corridors too narrow to turn in, with a goal ahead and then one behind, as Warp functions.

Things come out of the walls when the robot is near, ahead and, on the way back, behind: the robot must choose
a side before it is there, and has not seen where it reverses to.
"""

import warp as wp

from spin_rl.scenes.corridors.params import HIDDEN_DEPTH_M
from spin_rl.scenes.corridors.struct import ParamsStruct
from spin_rl.scenes.motion import Track
from spin_rl.scenes.rooms.geometry import Site, with_rectangle
from spin_rl.scenes.rooms.struct import FamilyStruct
from spin_rl.scenes.rooms.walls import put_walls
from spin_rl.warp_kernels.slots import Slots, put_slot

_DEPTH = wp.constant(HIDDEN_DEPTH_M)

_FIRST = wp.constant(0.8)
"""Distance from the start to the first thing ahead [m]: 0.7 m from the robot's front."""

_PITCH = wp.constant(0.75)
"""Distance between things [m]: the robot is 0.35 m long, and must change sides between them."""

_JITTER = wp.constant(0.08)
_HALF_LENGTH = wp.constant(wp.vec2(0.04, 0.08))

_LEAST_PROTRUSION = wp.constant(0.08)
"""How far things reach into the corridor at least [m]."""

_FLOATING_MORE = wp.constant(0.02)
"""How much farther floating things reach [m]: they meet the mast, which is inside the base's width."""

_FLOATING_LEFT = wp.constant(0.85)
"""Share of floating things on the left, where the mast is; of low ones as many are on the right."""

_ROOM = wp.constant(0.5)
"""From the goals to the corridor's ends [m]."""

_SIGHT_PROOF = wp.constant(1.6)
"""Walls are at least so high [m]: nothing is seen above them."""

_ASKEW = wp.constant(0.03)
"""Start poses are turned by so much at most [rad]."""

wp.set_module_options({"enable_backward": False})


@wp.func
def shuttle_ends(q: FamilyStruct, seed: int) -> wp.vec2:
    """Where the first goal is ahead of the start, and the second one behind it [m]."""
    state = wp.rand_init(seed, 1)
    ahead = wp.lerp(q.shuttle_ahead[0], q.shuttle_ahead[1], wp.randf(state))
    return wp.vec2(ahead, -wp.lerp(q.shuttle_back[0], q.shuttle_back[1], wp.randf(state)))


@wp.func
def _put_thing(
    world: int,
    x: float,
    width: float,
    p: ParamsStruct,
    q: FamilyStruct,
    seed: int,
    site: Site,
    slots: Slots,
    track: Track,
) -> Site:
    """Write what comes out of a wall about x."""
    state = wp.rand_init(seed, 0)
    floats = wp.randf(state) < q.shuttle_floating_share
    left = wp.randf(state) < _FLOATING_LEFT
    if not floats:
        left = not left
    most = width - q.shuttle_passage
    reach = wp.lerp(wp.min(_LEAST_PROTRUSION, most), most, wp.randf(state))
    low = float(0.0)
    high = wp.lerp(p.low_top[0], p.low_top[1], wp.randf(state))
    if floats:
        reach += _FLOATING_MORE
        low = wp.lerp(q.shuttle_floating[0], q.shuttle_floating[1] - 0.1, wp.randf(state))
        high = wp.min(low + wp.lerp(0.1, 0.3, wp.randf(state)), q.shuttle_floating[1])
    side = wp.where(left, 1.0, -1.0)
    half = wp.vec3(
        wp.lerp(_HALF_LENGTH[0], _HALF_LENGTH[1], wp.randf(state)), 0.5 * reach, 0.5 * (high - low)
    )
    centre = wp.vec3(x, side * 0.5 * (width - reach), 0.5 * (low + high))
    now = site
    slot = now.first_box + now.boxes
    put_slot(world, slot, centre, 0.0, half, slots)
    track.home[world, slot] = centre
    track.retreat[world, slot] = wp.vec2(0.0, side * (reach + _DEPTH))
    track.speed[world, slot] = wp.lerp(q.shuttle_speed[0], q.shuttle_speed[1], wp.randf(state))
    track.trigger[world, slot] = wp.lerp(q.shuttle_trigger[0], q.shuttle_trigger[1], wp.randf(state))
    track.phase[world, slot] = 0.0
    now.boxes = now.boxes + 1
    now.obstacles = now.obstacles + 1
    return now


@wp.func
def build_shuttle(
    world: int, p: ParamsStruct, q: FamilyStruct, seed: int, site: Site, slots: Slots, track: Track
) -> Site:
    """A corridor along x with the start at the origin; things ahead up to the first goal, and behind."""
    state = wp.rand_init(seed, 0)
    width = wp.lerp(q.shuttle_width[0], q.shuttle_width[1], wp.randf(state))
    height = wp.max(wp.lerp(p.wall_height[0], p.wall_height[1], wp.randf(state)), _SIGHT_PROOF)
    ends = shuttle_ends(q, seed)
    now = with_rectangle(site, ends[1] - _ROOM, -0.5 * width, ends[0] + _ROOM, 0.5 * width)
    now = put_walls(world, p.wall_thickness, height, now, slots)
    x = _FIRST + _JITTER * wp.randf(state)
    while x <= ends[0] + 0.1:
        now = _put_thing(world, x, width, p, q, int(wp.rand_init(seed, 10 + now.boxes)), now, slots, track)
        x += _PITCH + _JITTER * wp.randf(state)
    # Those behind must not come out before the robot comes back.
    x = -(q.shuttle_trigger[1] + _JITTER) - _JITTER * wp.randf(state)
    while x >= ends[1]:
        now = _put_thing(world, x, width, p, q, int(wp.rand_init(seed, 10 + now.boxes)), now, slots, track)
        x -= _PITCH + _JITTER * wp.randf(state)
    return now


@wp.func
def shuttle_start(seed: int) -> wp.vec3:
    """Base pose at the start."""
    return wp.vec3(0.0, 0.0, _ASKEW * (2.0 * wp.randf(wp.rand_init(seed, 2)) - 1.0))
