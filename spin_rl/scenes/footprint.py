# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportCallIssue=false
# pyright: reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""A simple model of the robot, as Warp functions: which poses keep their distance from everything.

The model covers the Stretch RE1's collision shape (official URDF) with upright discs, each with a height
range. It is coarse but errs on the safe side.
"""

import warp as wp

from spin_rl import robot
from spin_rl.warp_kernels.slots import Slots

vec8 = wp.types.vector(length=len(robot.JOINTS), dtype=float)
"""Joint positions in `robot.JOINTS` order [m or rad]."""

wp.set_module_options({"enable_backward": False})

# Positions in robot.JOINTS.
_LIFT = wp.constant(0)
_ARM = wp.constant(1)
_WRIST_YAW = wp.constant(2)
_WRIST_PITCH = wp.constant(3)
_FINGER = wp.constant(5)

_BASE_REAR = wp.constant(robot.BASE_X_M[0])
_BASE_FRONT = wp.constant(robot.BASE_X_M[1])
_BASE_SIDE = wp.constant(robot.BASE_HALF_WIDTH_M)
_BASE_TOP = wp.constant(robot.BASE_TOP_M)
_MAST = wp.constant(wp.vec2(-0.067, 0.135))
_TOP = wp.constant(1.42)
_HALF_PI = wp.constant(1.5707964)

NUM_BASE = wp.constant(16)
"""The first discs of the robot's model are the outline of the base."""
_NUM_LIFT = wp.constant(6)
_NUM_ARM = wp.constant(6)
NUM_DISCS = wp.constant(35)
"""Discs of the robot's model: base outline, mast, head (2), lift body, arm, gripper."""

_REACH = wp.constant(1.2)
"""No disc reaches farther from the base's origin [m], whatever the joints."""


@wp.struct
class Disc:
    """An upright cylinder of the robot in its base frame."""

    centre: wp.vec2
    radius: float
    low: float
    high: float


@wp.func
def _disc(x: float, y: float, radius: float, low: float, high: float) -> Disc:
    d = Disc()
    d.centre = wp.vec2(x, y)
    d.radius = radius
    d.low = low
    d.high = high
    return d


@wp.func
def robot_disc(i: int, joints: vec8) -> Disc:
    """Disc i of the robot's model, in the base frame, for joints in `robot.JOINTS` order."""
    k = i
    if k < NUM_BASE:
        # Four points on each side of the base box, counter-clockwise from the rear right corner.
        edge = k // 4
        f = float(k % 4) / 4.0
        x = wp.lerp(_BASE_REAR, _BASE_FRONT, f)
        y = -_BASE_SIDE
        if edge == 1:
            x = _BASE_FRONT
            y = wp.lerp(-_BASE_SIDE, _BASE_SIDE, f)
        if edge == 2:
            x = wp.lerp(_BASE_FRONT, _BASE_REAR, f)
            y = _BASE_SIDE
        if edge == 3:
            x = _BASE_REAR
            y = wp.lerp(_BASE_SIDE, -_BASE_SIDE, f)
        return _disc(x, y, 0.0, 0.0, _BASE_TOP)
    k -= NUM_BASE
    if k == 0:
        return _disc(_MAST[0], _MAST[1], 0.05, 0.0, _TOP)
    if k == 1:
        return _disc(0.0, 0.0, 0.12, 1.18, _TOP)
    if k == 2:
        return _disc(-0.04, 0.08, 0.10, 1.34, _TOP)
    k -= 3
    lift = joints[_LIFT]
    if k < _NUM_LIFT:
        # Two rows of three discs over x in [-0.26, -0.03], y in [0, 0.17].
        return _disc(
            -0.22 + 0.075 * float(k % 3), 0.043 + 0.085 * float(k // 3), 0.06, lift + 0.15, lift + 0.29
        )
    k -= _NUM_LIFT
    wrist = wp.vec2(-0.021, -0.145 - joints[_ARM])
    if k < _NUM_ARM - 1:
        return _disc(-0.104, wrist[1] * float(k + 1) / float(_NUM_ARM - 1), 0.05, lift + 0.16, lift + 0.23)
    if k == _NUM_ARM - 1:
        return _disc(wrist[0], wrist[1], 0.09, lift + 0.09, lift + 0.23)
    k -= _NUM_ARM
    # From the wrist to the fingertips, 0.29 m ahead; open fingers spread out.
    ahead = 0.08 + 0.07 * float(k)
    direction = joints[_WRIST_YAW] - _HALF_PI
    sag = ahead * wp.abs(wp.sin(joints[_WRIST_PITCH]))
    return _disc(
        wrist[0] + ahead * wp.cos(direction),
        wrist[1] + ahead * wp.sin(direction),
        0.06 + 0.07 * float(k) * wp.max(wp.sin(joints[_FINGER]), 0.0),
        lift + 0.05 - sag,
        lift + 0.17 + sag,
    )


@wp.func
def disc_touches(
    disc: Disc,
    x: float,
    y: float,
    margin: float,
    centre: wp.vec3,
    yaw: float,
    half: wp.vec3,
    is_cylinder: bool,
) -> bool:
    """Whether a disc at (x, y) in the world comes closer to a slot than a margin."""
    if disc.high + margin < centre[2] - half[2] or disc.low - margin > centre[2] + half[2]:
        return False
    dx = x - centre[0]
    dy = y - centre[1]
    c = wp.cos(yaw)
    s = wp.sin(yaw)
    reach = disc.radius + margin
    if is_cylinder:
        return dx * dx + dy * dy < (reach + half[0]) * (reach + half[0])
    ax = wp.max(wp.abs(c * dx + s * dy) - half[0], 0.0)
    ay = wp.max(wp.abs(c * dy - s * dx) - half[1], 0.0)
    return ax * ax + ay * ay < reach * reach


@wp.func
def pose_touches_slot(
    world: int, slot: int, pose: wp.vec3, joints: vec8, discs: int, margin: float, slots: Slots
) -> bool:
    """Whether one of the model's first `discs` discs comes nearer than a margin [m] to a slot.

    The pose is that of the base: x, y [m], yaw [rad].
    """
    centre = slots.pos[world, slot]
    half = slots.half_size[world, slot]
    reach = _REACH + margin + wp.length(wp.vec2(half[0], half[1]))
    if wp.length_sq(wp.vec2(pose[0] - centre[0], pose[1] - centre[1])) >= reach * reach:
        return False
    c = wp.cos(pose[2])
    s = wp.sin(pose[2])
    for i in range(discs):
        disc = robot_disc(i, joints)
        x = pose[0] + c * disc.centre[0] - s * disc.centre[1]
        y = pose[1] + s * disc.centre[0] + c * disc.centre[1]
        yaw = slots.yaw[world, slot]
        if disc_touches(disc, x, y, margin, centre, yaw, half, slots.is_cylinder[slot]):
            return True
    return False


@wp.func
def pose_touches(world: int, pose: wp.vec3, joints: vec8, discs: int, margin: float, slots: Slots) -> bool:
    """Whether one of the model's first `discs` discs comes nearer than a margin [m] to an active slot.

    The pose is that of the base: x, y [m], yaw [rad].
    """
    for slot in range(slots.pos.shape[1]):
        if slots.active[world, slot]:
            if pose_touches_slot(world, slot, pose, joints, discs, margin, slots):
                return True
    return False


@wp.func
def pose_is_clear(world: int, pose: wp.vec3, joints: vec8, margin: float, slots: Slots) -> bool:
    """Whether a robot pose (x, y, yaw) keeps a margin [m] from every active slot of a world."""
    return not pose_touches(world, pose, joints, NUM_DISCS, margin, slots)
