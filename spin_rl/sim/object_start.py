# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""The object's state at the start of an episode, and the action that holds the robot still."""

import warp as wp

from spin_rl import robot
from spin_rl.sim.targets import INCREMENTAL, Increments

_FIRST = wp.constant(len(robot.DOF_NAMES))
_FINGER_DOF = wp.constant(robot.DOF_NAMES.index("finger_left"))
_FINGER_ACTION = wp.constant(robot.ACTIONS.index("gripper_finger"))


@wp.func
def hold_still(
    w: int, qpos: wp.array2d(dtype=float), increments: Increments, action: wp.array2d(dtype=float)
) -> None:
    """Write the action of the incremental mode that holds the robot's pose."""
    for i in range(action.shape[1]):
        action[w, i] = 0.0
    hold = (qpos[w, _FINGER_DOF] - increments.gripper_middle) / increments.gripper_span
    action[w, _FINGER_ACTION] = wp.clamp(hold, -1.0, 1.0)


@wp.kernel
def _place_objects(
    # In
    increments: Increments,
    mask: wp.array(dtype=bool),
    start_pose: wp.array(dtype=wp.vec4),
    mode: wp.array(dtype=wp.int32),
    # Out
    qpos_out: wp.array2d(dtype=float),
    action_out: wp.array2d(dtype=float),
) -> None:
    w = wp.tid()
    if not mask[w]:
        return
    pose = start_pose[w]
    for i in range(3):
        qpos_out[w, _FIRST + i] = pose[i]
    qpos_out[w, _FIRST + 3] = wp.cos(0.5 * pose[3])
    qpos_out[w, _FIRST + 4] = 0.0
    qpos_out[w, _FIRST + 5] = 0.0
    qpos_out[w, _FIRST + 6] = wp.sin(0.5 * pose[3])
    if mode[w] == INCREMENTAL:
        hold_still(w, qpos_out, increments, action_out)


def place_objects(
    increments: Increments,
    mask: wp.array,
    start_pose: wp.array,
    mode: wp.array,
    *,
    qpos: wp.array,
    action: wp.array,
) -> None:
    """Write the objects' start poses of the masked worlds; graph-safe.

    Args:
        increments: Give the meaning of the gripper's action.
        mask: Worlds to write, shape (nworld,), bool.
        start_pose: Position of the object's centre [m] and its yaw [rad], shape (nworld,), vec4.
        mode: `targets.ABSOLUTE` or `targets.INCREMENTAL`, shape (nworld,), int32.
        qpos: Positions with the robot's start pose; the object's are written, shape (nworld, 20).
        action: Output, in incremental worlds the action that holds the start pose, shape (nworld, 10).
    """
    wp.launch(
        _place_objects,
        dim=mask.shape[0],
        inputs=[increments, mask, start_pose, mode],
        outputs=[qpos, action],
        device=qpos.device,
    )
