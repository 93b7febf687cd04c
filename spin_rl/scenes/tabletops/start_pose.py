# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportCallIssue=false
# pyright: reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Where the robot stands and how it holds its arm before it picks something up, as Warp functions.

Heights of the hand come from the arm's geometry, which is simple: lift and arm are slides, and the gripper
points along the arm but for its pitch.
"""

import warp as wp

from spin_rl import robot
from spin_rl.scenes.footprint import vec8
from spin_rl.scenes.tabletops.params import TabletopStruct

_LIFT_MAX = wp.constant(robot.JOINT_UPPER[0])
_ARM_MAX = wp.constant(robot.JOINT_UPPER[1])
# The hand in the base frame at the zero pose, from the MJCF: the wrist pitch joint's position (y and z also
# move with arm and lift), and the grasp centre seen from it, ahead and below.
HAND_X_M = -0.0214
_HAND_X = wp.constant(HAND_X_M)
_PITCH_Y = wp.constant(-0.14495)
_PITCH_Z = wp.constant(robot.HAND_Z_M)
_AHEAD = wp.constant(robot.HAND_AHEAD_M)
_BELOW = wp.constant(robot.HAND_BELOW_M)
# The palm's capsule seen from there: its front end and how far its skin is below; the pads' skin likewise.
_PALM_AHEAD = wp.constant(0.1249)
_PALM_BELOW = wp.constant(0.0735)
_PADS_BELOW = wp.constant(0.045)
_PALM_FRONT = wp.constant(0.09)
"""How close the palm's front comes to the grasp centre, with a margin."""
_PADS_HALF_HEIGHT = wp.constant(0.027)
_ROLL_DROP = wp.constant(0.02)
"""How much lower a finger gets by the start's roll."""
_HAND_HALF_WIDTH = wp.constant(0.04)
"""What the open fingers add to the reach of a gripper that is turned against the table."""
_HEAD_X = wp.constant(robot.HEAD_X_M)
_HEAD_Z = wp.constant(robot.HEAD_Z_M)
_PAN = robot.JOINTS.index("head_pan")
_PAN_MIN = wp.constant(robot.JOINT_LOWER[_PAN])
_PAN_MAX = wp.constant(robot.JOINT_UPPER[_PAN])

wp.set_module_options({"enable_backward": False})


@wp.struct
class Start:
    """Pose of base (x, y, yaw) and joints at the start."""

    base: wp.vec3
    joints: vec8


@wp.func
def between(pair: wp.vec2, u: float) -> float:
    """Map a uniform number to a range (low, high)."""
    return wp.lerp(pair[0], pair[1], u)


@wp.func
def either_way(most: float, u: float) -> float:
    """Map a uniform number to [-most, most]."""
    return most * (2.0 * u - 1.0)


@wp.func
def lift_of(grasp_z: float, down: float) -> float:
    """Lift that puts the grasp centre at a height, for a gripper pitched down by an angle."""
    return grasp_z - _PITCH_Z + _AHEAD * wp.sin(down) + _BELOW * wp.cos(down)


@wp.func
def _ahead_of(down: float) -> float:
    """Distance from the pitch joint to the grasp centre along the gripper's horizontal direction."""
    return _AHEAD * wp.cos(down) - _BELOW * wp.sin(down)


@wp.func
def far_start(
    p: TabletopStruct, state: wp.uint32, level: float, target: wp.vec3, radius: float, edge: float, top: float
) -> Start:
    """A start beside the table, clear of table and object."""
    s = Start()
    x = either_way(p.base_x, wp.randf(state))
    y = either_way(p.base_y, wp.randf(state))
    yaw = either_way(p.base_yaw, wp.randf(state))
    arm = between(p.start_arm_extension, wp.randf(state))
    s.joints[2] = between(p.start_wrist_yaw, wp.randf(state))
    down = -between(p.start_wrist_pitch, wp.randf(state))
    s.joints[4] = between(p.start_wrist_roll, wp.randf(state))
    s.joints[5] = between(p.start_gripper_finger, wp.randf(state))
    reach = arm - _PITCH_Y + _ahead_of(down) + _HAND_HALF_WIDTH
    # Keep away from the object itself: the start is beside the table, not over the object.
    front = reach * wp.cos(yaw) + wp.abs(_HAND_X) * wp.abs(wp.sin(yaw)) - y
    retreat = wp.max(front + p.clearance - (-target[1] - radius), 0.0)
    y += retreat
    front -= retreat
    drop = wp.max(_AHEAD * wp.sin(down) + _PADS_BELOW, _PALM_AHEAD * wp.sin(down) + _PALM_BELOW)
    under = drop + _ROLL_DROP + p.clearance - _PITCH_Z
    lift_min = under
    if front + p.clearance > edge - 0.4 * p.table_yaw:
        lift_min = top + under
    lift_min = wp.clamp(lift_min, 0.0, _LIFT_MAX)
    anywhere = wp.randf(state) < 0.5 * level
    u = wp.randf(state)
    lift = lift_of(target[2] + between(p.start_above, u), down)
    if anywhere:
        lift = wp.lerp(lift_min, _LIFT_MAX, u)
    s.joints[0] = wp.clamp(lift, lift_min, _LIFT_MAX)
    s.joints[1] = arm
    s.joints[3] = -down
    s.base = wp.vec3(x, y, yaw)
    return s


@wp.func
def near_start(p: TabletopStruct, state: wp.uint32, target: wp.vec3, radius: float, top: float) -> Start:
    """A start with the open gripper pointing at the object, close to it and at its height."""
    s = Start()
    yaw = either_way(p.base_yaw, wp.randf(state))
    aside = _HAND_X + either_way(0.015, wp.randf(state))
    # Low objects are reached for from above, so that the palm stays clear of the table.
    height = target[2] - top
    down_min = wp.asin(wp.clamp((0.06 - height) / (_AHEAD - _PALM_AHEAD), 0.0, 0.5))
    down = wp.lerp(down_min, wp.max(down_min, 0.4), wp.randf(state))
    grasp_z = wp.max(target[2], top + _PADS_HALF_HEIGHT) + between(p.near_above, wp.randf(state))
    short = wp.max(between(p.near_distance, wp.randf(state)), radius - _PALM_FRONT)
    distance = -target[1]
    s.joints[0] = wp.clamp(lift_of(grasp_z, down), 0.0, _LIFT_MAX)
    s.joints[1] = wp.clamp(distance - short + _PITCH_Y - _ahead_of(down), 0.0, _ARM_MAX)
    s.joints[3] = -down
    s.joints[5] = p.near_finger
    # The object at (aside, -distance) in the base frame.
    c = wp.cos(yaw)
    si = wp.sin(yaw)
    s.base = wp.vec3(target[0] - (c * aside + si * distance), target[1] - (si * aside - c * distance), yaw)
    return s


@wp.func
def head_towards(base: wp.vec3, target: wp.vec3) -> wp.vec2:
    """Head pan, in [-pi, pi], and tilt that look at a target from a base pose (x, y, yaw) [rad]."""
    c = wp.cos(base[2])
    s = wp.sin(base[2])
    dx = target[0] - base[0]
    dy = target[1] - base[1]
    ahead = c * dx + s * dy - _HEAD_X
    left = c * dy - s * dx
    down = wp.atan2(_HEAD_Z - target[2], wp.sqrt(ahead * ahead + left * left))
    return wp.vec2(wp.atan2(left, ahead), -down)


@wp.func
def within_reach(pan: float) -> float:
    """The head's pan nearest to a bearing in [-pi, pi]; it turns farther to the right than to the left."""
    if pan - _PAN_MAX > 2.0 * wp.pi + _PAN_MIN - pan:  # nearer by the long way round to the right
        pan -= 2.0 * wp.pi
    return wp.clamp(pan, _PAN_MIN, _PAN_MAX)


@wp.func
def look_at(p: TabletopStruct, state: wp.uint32, target: wp.vec3, start: Start) -> Start:
    """The same start with the head turned somewhere about a target."""
    centre = head_towards(start.base, target)
    pan = centre[0] + either_way(p.look_pan, wp.randf(state))
    tilt = either_way(p.look_tilt, wp.randf(state)) + centre[1]
    start.joints[6] = wp.clamp(pan, p.start_head_pan[0], p.start_head_pan[1])
    start.joints[7] = wp.clamp(tilt, p.start_head_tilt[0], p.start_head_tilt[1])
    return start
