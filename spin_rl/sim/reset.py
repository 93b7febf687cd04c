# pyright: reportInvalidTypeForm=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""The robot's state at the start of an episode."""

import warp as wp

from spin_rl.sim.drive import DriveLimits
from spin_rl.sim.targets import action_for


@wp.kernel
def _set_start_state(
    # Model
    dof_joint: wp.array(dtype=wp.int32),
    dof_share: wp.array(dtype=float),
    joint_low: wp.array(dtype=float),
    joint_default: wp.array(dtype=float),
    joint_high: wp.array(dtype=float),
    # In
    mask: wp.array(dtype=bool),
    start: wp.array(dtype=wp.vec3),
    start_joints: wp.array2d(dtype=float),
    # Out
    qpos_out: wp.array2d(dtype=float),
    base_velocity_out: wp.array2d(dtype=float),
    target_out: wp.array2d(dtype=float),
    action_out: wp.array2d(dtype=float),
) -> None:
    w = wp.tid()
    if not mask[w]:
        return
    for i in range(3):
        qpos_out[w, i] = start[w][i]
    for dof in range(3, dof_joint.shape[0]):
        qpos_out[w, dof] = dof_share[dof] * start_joints[w, dof_joint[dof]]
    base_velocity_out[w, 0] = 0.0
    base_velocity_out[w, 1] = 0.0
    # The action that would hold this pose, so that the first observation of the last action is true.
    action_out[w, 0] = 0.0
    action_out[w, 1] = 0.0
    for joint in range(start_joints.shape[1]):
        target_out[w, joint] = start_joints[w, joint]
        action_out[w, joint + 2] = action_for(
            start_joints[w, joint], joint_low[joint], joint_default[joint], joint_high[joint]
        )


def set_start_state(
    limits: DriveLimits,
    mask: wp.array,
    *,
    start: wp.array,
    start_joints: wp.array,
    qpos: wp.array,
    base_velocity: wp.array,
    target: wp.array,
    action: wp.array,
) -> None:
    """Write the start pose of the masked worlds into the simulator's state.

    Args:
        limits: The robot's limits.
        mask: Worlds to write, shape (nworld,), bool.
        start: Base pose (x [m], y [m], yaw [rad]) in the world, shape (nworld,).
        start_joints: Joint positions in `robot.JOINTS` order [m or rad], shape (nworld, 8).
        qpos: Output, generalized positions, the robot's first, shape (nworld, 13 or more).
        base_velocity: Output, commanded base velocity (zero), shape (nworld, 2).
        target: Output, the joint targets (the start pose), shape (nworld, 8).
        action: Output, the action that would hold the start pose in the absolute mode, shape (nworld, 10).
    """
    wp.launch(
        _set_start_state,
        dim=mask.shape[0],
        inputs=[
            limits.dof_joint,
            limits.dof_share,
            limits.joint_low,
            limits.joint_default,
            limits.joint_high,
            mask,
            start,
            start_joints,
        ],
        outputs=[qpos, base_velocity, target, action],
        device=qpos.device,
    )
