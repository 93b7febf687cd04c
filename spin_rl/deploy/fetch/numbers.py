"""The numbers of a fetch's stages and scripts, for training and robot alike."""

from __future__ import annotations

STAGES = ("reach", "align", "pick", "retract", "carry", "place")
"""A fetch's stages in their order; see `spin_rl.tasks.fetch.state`."""
REACH, ALIGN, PICK, RETRACT, CARRY, PLACE = range(len(STAGES))
RELEASE_PHASE = 4
"""Phase of `place` from which the fingers open."""

# What is told of hand and object.
HOLDS_N = 2.0
"""Fingertips that press with more than this hold something, or stand on it."""
LOOSE_N = 1.0
"""Fingertips that press the object with less than this together do not hold it."""
LOOSE_STEPS = 3
REST_SPEED = 0.05
"""An object slower than this is at rest [m/s]."""

# How fast.
STILL = 0.01
"""Slower than this the base stands [m/s, rad/s]."""
STUCK_STEPS = 5
RATES = (0.25, 0.25, 1.5, 1.0, 1.0, 1.5, 3.0, 2.0)
"""How fast targets move [m/s, rad/s], in the order of the joints."""
CARRY_LIFT_RATE = 0.15
"""How fast the lift moves while the navigation policy drives with an object in the hand [m/s]."""
CARRY_RATE = 0.6
"""Part of these rates with an object in the hand."""
LOWER_RATE = 0.12
DEEPEN_RATE = 0.3
"""How fast the lift goes down, and then the wrist, until what is held stands [m/s, rad/s]."""
HEAD_SWEEP = 1.5
"""Speed of the head's pan while it looks for the object [rad/s]."""
BASE_SWEEP = 0.6
"""Speed of the base's turn meanwhile, where the head is held [rad/s]."""
AT_ONCE = 10.0
"""A change of the fingers' target that is none of these rates [rad]."""

# Moves of the base.
NEAR_M = 0.03
"""The base is at a point that is nearer than this."""
TURN_TOLERANCE = 0.04
BUMPER_M = 0.03
BUMPER_S = 0.4
"""The base keeps so far from everything that it would come nearer to than that in this time."""

# Align.
LOOK_TILT = -0.6
STAND_M = 0.70
"""Distance of the base from the object to pick it from; the pick task has 0.57 to 0.85 m."""
DETOUR_M = 0.35
"""How far back from there the robot drives first where it has no room to turn to it."""
ABOVE_M = 0.12
"""Height of the gripper over the object's centre at the start of a pick."""
PICK_PITCH = -0.15
OPEN = 0.45
"""Finger angle at the start of a pick and to put down [rad]."""

# Retract and carry.
RAISE_M = 0.1
"""How much further the object is lifted before the arm comes in."""
GRIP_LEAD = 0.14
"""How far the fingers' target is within where they are [rad]. With both servos at their limit nothing would
keep the object from wandering sideways between the fingers."""
BACK_M = 0.05
"""How far behind the middle of the corridor, across it, the robot folds the wrist."""

# Place: the arm extends past the base's side and the gripper points ahead of the base.
PLACE_ARM_M = 0.13
PLACE_YAW = 1.9
PLACE_SPREAD = 0.6
"""Deeper than this pitch downwards the hand turns away from the base by as much, or a finger would hit it."""
ASIDE_M = 0.08
"""How far the robot may be from the spot to put down from."""
FAR_SIDE_M = 0.2
"""How far that spot may be from the middle of the corridor, on the side away from the hand."""
HOMING_S = 8.0
"""Longest time to drive there [s]."""
PLACE_LIFT_M = 0.55
DEEPEST_PITCH = -0.9
UP_M = 0.3
"""How far the open hand goes up."""
OPENING_STEPS = 10
SETTLE = 3
"""Steps that joints get to follow targets that stand still."""
MOVED = 1.0e-3
"""Targets nearer than this to where they are going stand still [m, rad]."""
