# pyright: reportInvalidTypeForm=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""From targets to servo set-points: the robot's own low-level controller, run before every substep.

Joints follow their targets as first-order systems with a speed limit, which is exact at the simulator's
timestep where stiff position servos are not; the base follows a body-frame velocity command.
"""

from dataclasses import dataclass

import warp as wp

from spin_rl import robot


@wp.kernel
def _drive(
    # Model
    dof_joint: wp.array(dtype=wp.int32),
    dof_share: wp.array(dtype=float),
    joint_speed: wp.array(dtype=float),
    base_acceleration: wp.array(dtype=float),
    timestep: float,
    # Per world
    lag: wp.array2d(dtype=float),
    speed_scale: wp.array(dtype=float),
    acceleration_scale: wp.array(dtype=float),
    base_target: wp.array2d(dtype=float),
    target: wp.array2d(dtype=float),
    qpos: wp.array2d(dtype=float),
    # Out
    base_velocity_out: wp.array2d(dtype=float),
    ctrl_out: wp.array2d(dtype=float),
) -> None:
    w = wp.tid()
    scale = speed_scale[w]

    blend = 1.0 - wp.exp(-timestep / lag[w, 0])
    most = acceleration_scale[w] * base_acceleration[0] * timestep
    dv = wp.clamp((base_target[w, 0] - base_velocity_out[w, 0]) * blend, -most, most)
    most = acceleration_scale[w] * base_acceleration[1] * timestep
    dw = wp.clamp((base_target[w, 1] - base_velocity_out[w, 1]) * blend, -most, most)
    # The mean velocity of the substep: its end's would run half a substep ahead of the commands.
    v = base_velocity_out[w, 0] + 0.5 * dv
    turn = base_velocity_out[w, 1] + 0.5 * dw
    base_velocity_out[w, 0] = base_velocity_out[w, 0] + dv
    base_velocity_out[w, 1] = base_velocity_out[w, 1] + dw
    # The world-frame velocity over a substep that also turns: the midpoint yaw keeps the path exact to
    # second order.
    yaw = qpos[w, 2] + 0.5 * timestep * turn
    ctrl_out[w, 0] = v * wp.cos(yaw)
    ctrl_out[w, 1] = v * wp.sin(yaw)
    ctrl_out[w, 2] = turn

    gain = (1.0 - wp.exp(-timestep / lag[w, 1])) / timestep
    for dof in range(3, ctrl_out.shape[1]):
        joint = dof_joint[dof]
        share = dof_share[dof]
        goal = share * target[w, joint]
        limit = share * scale * joint_speed[joint]
        ctrl_out[w, dof] = wp.clamp((goal - qpos[w, dof]) * gain, -limit, limit)


@dataclass(frozen=True)
class DriveLimits:
    """The robot's limits as kernels read them, on one device.

    Attributes:
        joint_low: Lower joint limits in `robot.JOINTS` order [m or rad], shape (8,).
        joint_default: Joint set-points of a zero action, shape (8,).
        joint_high: Upper joint limits, shape (8,).
        joint_speed: Speed limits [m/s or rad/s], shape (8,).
        base_speed: Forward [m/s], reverse [m/s] and turning [rad/s] speed limits, shape (3,).
        base_acceleration: Linear [m/s^2] and angular [rad/s^2] acceleration limits, shape (2,).
        dof_joint: Index into `robot.JOINTS` of each degree of freedom, -1 for the base, shape (13,).
        dof_share: Share of the joint's motion that the degree of freedom makes, shape (13,).
    """

    joint_low: wp.array
    joint_default: wp.array
    joint_high: wp.array
    joint_speed: wp.array
    base_speed: wp.array
    base_acceleration: wp.array
    dof_joint: wp.array
    dof_share: wp.array

    @staticmethod
    def create(profile: robot.SpeedProfile, device: str) -> "DriveLimits":
        """Allocate the limits of a speed profile on a device."""

        def floats(values: object) -> wp.array:
            return wp.array(values, dtype=float, device=device)

        base = [-1, -1, -1]
        return DriveLimits(
            joint_low=floats(robot.JOINT_LOWER),
            joint_default=floats([robot.STOWED[name] for name in robot.JOINTS]),
            joint_high=floats(robot.JOINT_UPPER),
            joint_speed=floats(profile.joint_velocity_max),
            base_speed=floats([profile.forward_max, profile.reverse_max, profile.turn_max]),
            base_acceleration=floats([profile.base_acceleration, profile.turn_acceleration]),
            dof_joint=wp.array(
                base + [robot.JOINTS.index(j) for j, _ in robot.DOF_SOURCE], dtype=wp.int32, device=device
            ),
            dof_share=floats([1.0] * len(base) + [share for _, share in robot.DOF_SOURCE]),
        )


def drive(
    limits: DriveLimits,
    timestep: float,
    *,
    lag: wp.array,
    speed_scale: wp.array,
    acceleration_scale: wp.array,
    base_target: wp.array,
    target: wp.array,
    qpos: wp.array,
    base_velocity: wp.array,
    ctrl: wp.array,
) -> None:
    """Write the velocity set-points of one substep.

    Args:
        limits: The robot's limits.
        timestep: Substep [s].
        lag: Time constants of base and joints [s], shape (nworld, 2).
        speed_scale: Factor on every speed limit, shape (nworld,).
        acceleration_scale: Factor on the base's acceleration limits, shape (nworld,).
        base_target: Forward [m/s] and turning [rad/s] speed that the base shall reach, shape (nworld, 2).
        target: Joint targets in `robot.JOINTS` order [m or rad], shape (nworld, 8).
        qpos: Generalized positions, the robot's first, shape (nworld, 13 or more).
        base_velocity: Body-frame forward [m/s] and turning [rad/s] velocity commanded so far, shape
            (nworld, 2); updated in place.
        ctrl: Output, velocity set-point of each degree of freedom, shape (nworld, 13).
    """
    wp.launch(
        _drive,
        dim=qpos.shape[0],
        inputs=[
            limits.dof_joint,
            limits.dof_share,
            limits.joint_speed,
            limits.base_acceleration,
            timestep,
            lag,
            speed_scale,
            acceleration_scale,
            base_target,
            target,
            qpos,
        ],
        outputs=[base_velocity, ctrl],
        device=qpos.device,
    )
