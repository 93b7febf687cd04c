# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportAssignmentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""A step without forces: the servos do what they are told, and what touches is reported, not pushed back."""

import mujoco_warp as mjw
import warp as wp


@wp.kernel
def _integrate(
    # In
    ctrl: wp.array2d(dtype=float),
    timestep: float,
    # In and out
    qpos: wp.array2d(dtype=float),
    # Out
    qvel_out: wp.array2d(dtype=float),
) -> None:
    w, dof = wp.tid()
    qvel_out[w, dof] = ctrl[w, dof]
    qpos[w, dof] = qpos[w, dof] + timestep * ctrl[w, dof]


def kinematic_step(model: mjw.Model, data: mjw.Data, timestep: float) -> None:
    """Find the contacts of the present pose, then move all joints by their velocity set-points; graph-safe.

    As `mjw.step` without contact, whose velocity servos follow their set-points; what penetrates goes on.
    Poses of bodies and geoms are those before the motion, as after `mjw.step`. Velocities and centres of
    mass of bodies are not computed.

    Args:
        model: Of a robot whose degrees of freedom each have a velocity servo, in their order.
        data: Its state; `ctrl` holds the set-points.
        timestep: Length of the step [s].
    """
    mjw.kinematics(model, data)
    mjw.collision(model, data)
    wp.launch(
        _integrate,
        dim=data.ctrl.shape,
        inputs=[data.ctrl, timestep, data.qpos],
        outputs=[data.qvel],
        device=data.qpos.device,
    )
