# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Parameters of the corridor generator as its kernel reads them."""

from dataclasses import fields
from functools import lru_cache

import warp as wp

from spin_rl import robot
from spin_rl.scenes.corridors.params import START_RANGES, GeneratorParams, start_ranges
from spin_rl.scenes.footprint import vec8

# Read by the kernel in motion.py, which draws them from random numbers of its own.
_MOTION = ("emerging_share", "patrolling_share", "emerging_trigger", "motion_speed")


@wp.struct
class ParamsStruct:
    """`GeneratorParams` as the kernel reads them; joint ranges are absolute and clipped to the limits."""

    width: float
    easy_width: float
    length: float
    first_leg: wp.vec2
    behind_start: wp.vec2
    beyond_goal: wp.vec2
    wall_height: wp.vec2
    wall_thickness: float
    passage: float
    first_obstacle: float
    goal_clearance: float
    corner_clearance: float
    slalom_gap: float
    slalom_gain: float
    same_side_gap: float
    tall_share: float
    arm_share: float
    head_share: float
    cylinder_share: float
    standing_share: float
    corner_share: float
    hard_obstacles: int
    protrusion: wp.vec2
    standing_width: wp.vec2
    half_length: wp.vec2
    radius: wp.vec2
    box_yaw: float
    low_top: wp.vec2
    tall_top: wp.vec2
    arm_bottom: wp.vec2
    arm_thickness: wp.vec2
    head_bottom: wp.vec2
    head_thickness: wp.vec2
    max_distractors: int
    start_y: float
    start_clearance: float
    start_tries: int
    stowed: vec8
    start_low: vec8
    start_high: vec8


@lru_cache(maxsize=8)
def params_struct(params: GeneratorParams) -> ParamsStruct:
    """The kernel's copy of the parameters."""
    struct = ParamsStruct()
    for field in fields(GeneratorParams):
        if field.name in (*START_RANGES, *_MOTION):
            continue
        value = getattr(params, field.name)
        setattr(struct, field.name, wp.vec2(*value) if isinstance(value, tuple) else value)
    struct.stowed = vec8(*(robot.STOWED[joint] for joint in robot.JOINTS))
    low, high = start_ranges(params)
    struct.start_low, struct.start_high = vec8(*low), vec8(*high)
    return struct
