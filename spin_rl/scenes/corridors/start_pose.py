# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Start poses, as Warp functions: random, where the robot keeps its distance from everything."""

import warp as wp

from spin_rl.scenes.corridors.struct import ParamsStruct
from spin_rl.scenes.footprint import pose_is_clear
from spin_rl.warp_kernels.slots import Slots

wp.set_module_options({"enable_backward": False})


@wp.func
def put_start(
    world: int,
    p: ParamsStruct,
    seed: int,
    slots: Slots,
    start_out: wp.array(dtype=wp.vec3),
    start_joints_out: wp.array2d(dtype=float),
) -> None:
    """Write a random clear start pose near the origin, or the aligned and stowed one if no draw is clear."""
    state = wp.rand_init(seed, 2)
    pose = wp.vec3(0.0, 0.0, 0.0)
    joints = p.stowed
    # The camera looks anywhere in any case: it moves within the head's disc.
    for j in range(6, 8):
        joints[j] = wp.lerp(p.start_low[j], p.start_high[j], wp.randf(state))
    found = bool(False)
    for _try in range(p.start_tries):
        if not found:
            pose_try = wp.vec3(
                0.0, p.start_y * (2.0 * wp.randf(state) - 1.0), wp.pi * (2.0 * wp.randf(state) - 1.0)
            )
            joints_try = joints
            for j in range(6):
                joints_try[j] = wp.lerp(p.start_low[j], p.start_high[j], wp.randf(state))
            found = pose_is_clear(world, pose_try, joints_try, p.start_clearance, slots)
            if found:
                pose = pose_try
                joints = joints_try
    start_out[world] = pose
    for j in range(8):
        start_joints_out[world, j] = joints[j]
