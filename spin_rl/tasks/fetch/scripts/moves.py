# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Single moves of which the scripts of a fetch are made."""

import warp as wp

from spin_rl import robot
from spin_rl.deploy.fetch.numbers import HEAD_SWEEP, LOOK_TILT, NEAR_M
from spin_rl.scenes.footprint import vec8
from spin_rl.scenes.tabletops.start_pose import head_towards, within_reach

LIFT, ARM, YAW, PITCH, ROLL, FINGER, PAN, TILT = (
    wp.constant(robot.JOINTS.index(name)) for name in robot.JOINTS
)
"""Positions in `robot.JOINTS`."""
_PAN_MIN = wp.constant(robot.JOINT_LOWER[6])
_PAN_MAX = wp.constant(robot.JOINT_UPPER[6])
_FOLDED_YAW = wp.constant(robot.STOWED["wrist_yaw"])
_FOLDED_PITCH = wp.constant(robot.STOWED["wrist_pitch"])

wp.set_module_options({"enable_backward": False})


@wp.struct
class Command:
    """What a phase wants: base speeds [m/s, rad/s], joint targets, part of `_RATES`; whether it is done."""

    forward: float
    turn: float
    joints: vec8
    rate: float
    done: bool


@wp.func
def wrapped(angle: float) -> float:
    """The same angle in [-pi, pi]."""
    return wp.atan2(wp.sin(angle), wp.cos(angle))


@wp.func
def look(c: Command, base: wp.vec3, target: wp.vec3) -> Command:
    """The command with the head turned to a target."""
    centre = head_towards(base, target)
    c.joints[PAN] = within_reach(centre[0])
    c.joints[TILT] = centre[1]
    return c


@wp.func
def fold(c: Command) -> Command:
    """The command with the gripper folded back over the base."""
    c.joints[YAW] = _FOLDED_YAW
    c.joints[PITCH] = _FOLDED_PITCH
    c.joints[ROLL] = 0.0
    return c


@wp.func
def sweep(c: Command, steps: int, period: float) -> Command:
    """The command with the head turning to and fro over its whole range, from straight ahead to the right."""
    span = _PAN_MAX - _PAN_MIN
    way = float(steps) * period * HEAD_SWEEP + _PAN_MAX
    turn = wp.mod(way, 2.0 * span)
    c.joints[PAN] = wp.where(turn < span, _PAN_MAX - turn, _PAN_MAX - 2.0 * span + turn)
    c.joints[TILT] = LOOK_TILT
    return c


@wp.func
def drive_to(c: Command, base: wp.vec3, point: wp.vec2) -> Command:
    """The command that drives to a point, backwards if that is nearer."""
    to = point - wp.vec2(base[0], base[1])
    off = wrapped(wp.atan2(to[1], to[0]) - base[2])
    distance = wp.length(to)
    c.done = distance < NEAR_M
    if not c.done:
        if wp.abs(off) > 0.5 * wp.pi:
            off = wrapped(off + wp.pi)
            distance = -distance
        c.turn = wp.clamp(2.0 * off, -1.0, 1.0)
        # Slower in other directions, but not standing: near a wall the robot cannot turn before it moves.
        c.forward = wp.max(1.0 - wp.abs(off), 0.0) * wp.clamp(1.5 * distance, -0.1, 0.2)
    return c
