# pyright: reportGeneralTypeIssues=false
# (to a type checker, a Warp struct is an object, not a class)
"""Where the robot goes and where it starts, as Warp functions."""

import warp as wp

from spin_rl.scenes.corridors.params import ParamsStruct
from spin_rl.scenes.footprint import pose_is_clear, vec8
from spin_rl.scenes.motion import Track
from spin_rl.scenes.rooms.geometry import Site, spot_clearance, sweep_distance
from spin_rl.warp_kernels.slots import Slots

_TRIES = wp.constant(48)
_BESIDE_MOVER = wp.constant(0.5)
"""Start and goal keep this much from the edge of where something moves [m]: the robot fits, arm stowed."""

wp.set_module_options({"enable_backward": False})


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


@wp.func
def draw_goal(world: int, clearance: float, seed: int, site: Site, slots: Slots, track: Track) -> wp.vec2:
    """A random spot on the floor with the clearance, or the one with most of it that was drawn."""
    state = wp.rand_init(seed, 0)
    best = wp.vec2(0.0, 0.0)
    most = float(-1.0)
    for _try in range(_TRIES):
        if most < clearance:
            i = wp.min(int(float(site.num_rectangles) * wp.randf(state)), site.num_rectangles - 1)
            r = site.rectangles[i]
            x = wp.lerp(r[0], r[2], wp.randf(state))
            y = wp.lerp(r[1], r[3], wp.randf(state))
            if is_calm(world, x, y, slots, track):
                room = spot_clearance(world, x, y, clearance, slots)
                if room > most:
                    most = room
                    best = wp.vec2(x, y)
    return best


@wp.func
def floor_bounds(world: int, first_box: int, half_square: float, slots: Slots) -> wp.vec4:
    """Bounding rectangle of a world's walls, of the whole square without any."""
    low = wp.vec2(half_square, half_square)
    high = wp.vec2(-half_square, -half_square)
    for slot in range(first_box):
        if slots.active[world, slot]:
            pos = slots.pos[world, slot]
            half = slots.half_size[world, slot]
            low = wp.min(low, wp.vec2(pos[0] - half[0], pos[1] - half[1]))
            high = wp.max(high, wp.vec2(pos[0] + half[0], pos[1] + half[1]))
    if low[0] >= high[0]:
        return wp.vec4(-half_square, -half_square, half_square, half_square)
    return wp.vec4(low[0], low[1], high[0], high[1])


@wp.func
def wall_between(world: int, a: wp.vec2, b: wp.vec2, first_box: int, slots: Slots) -> bool:
    """Whether a wall stands on the straight line between two spots."""
    for slot in range(first_box):
        if slots.active[world, slot]:
            # Walls lie along the axes: the line is inside over the overlap of two intervals.
            enter = float(0.0)
            leave = float(1.0)
            for k in range(2):
                low = slots.pos[world, slot][k] - slots.half_size[world, slot][k]
                high = slots.pos[world, slot][k] + slots.half_size[world, slot][k]
                way = b[k] - a[k]
                if wp.abs(way) < 1.0e-6:
                    if a[k] < low or a[k] > high:
                        leave = -1.0
                else:
                    enter = wp.max(enter, wp.min((low - a[k]) / way, (high - a[k]) / way))
                    leave = wp.min(leave, wp.max((low - a[k]) / way, (high - a[k]) / way))
            if enter < leave:
                return True
    return False


@wp.func
def draw_joints(p: ParamsStruct, seed: int, index: int) -> vec8:
    """Random joints within the start ranges, in `robot.JOINTS` order."""
    state = wp.rand_init(seed, index)
    joints = vec8()
    for j in range(8):
        joints[j] = wp.lerp(p.start_low[j], p.start_high[j], wp.randf(state))
    return joints


@wp.func
def turned_clear(world: int, spot: wp.vec2, joints: vec8, yaw: float, margin: float, slots: Slots) -> wp.vec4:
    """A pose at a spot, turned until it is clear: (x, y, yaw, 1 if it is)."""
    for i in range(8):
        pose = wp.vec3(spot[0], spot[1], yaw + 0.25 * wp.pi * float(i))
        if pose_is_clear(world, pose, joints, margin, slots):
            return wp.vec4(pose[0], pose[1], pose[2], 1.0)
    return wp.vec4(spot[0], spot[1], yaw, 0.0)
