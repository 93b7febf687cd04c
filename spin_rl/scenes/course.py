# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportArgumentType=false, reportAttributeAccessIssue=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Which obstacles a robot in some pose touches, by the model of upright discs of `footprint`."""

from typing import Any

import warp as wp

from spin_rl.scenes.footprint import NUM_DISCS, pose_touches_slot, vec8
from spin_rl.warp_kernels.slots import Slots

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _touched(
    # In
    slots: Slots,
    is_wall: wp.array[wp.bool],
    pose: wp.array[wp.vec3],
    joints: wp.array2d[float],
    margin: float,
    # Out
    touched_out: wp.array2d[wp.bool],
) -> None:
    world, slot = wp.tid()
    touched_out[world, slot] = False
    if is_wall[slot] or not slots.active[world, slot]:
        return
    held = vec8()
    for j in range(joints.shape[1]):
        held[j] = joints[world, j]
    touched_out[world, slot] = pose_touches_slot(world, slot, pose[world], held, NUM_DISCS, margin, slots)


def find_touched(
    slots: Any, is_wall: wp.array, pose: wp.array, joints: wp.array, margin: float, *, touched_out: wp.array
) -> None:
    """Write which obstacles robots in given poses come nearer to than a margin; graph-safe.

    Args:
        slots: `Slots`; walls and inactive ones are not touched.
        is_wall: Whether a slot is a wall, shape (nslot,), bool.
        pose: Base poses (x [m], y [m], yaw [rad]), shape (nworld,), vec3.
        joints: Joint positions in `robot.JOINTS` order [m or rad], shape (nworld, 8).
        margin: Distance that counts as touching [m].
        touched_out: Output, shape (nworld, nslot), bool.
    """
    wp.launch(
        _touched,
        dim=touched_out.shape,
        inputs=[slots, is_wall, pose, joints, margin],
        outputs=[touched_out],
        device=touched_out.device,
    )
