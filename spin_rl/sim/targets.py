# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""From actions to what the low-level controller follows: joint targets and base speeds, once a control step.

Navigation commands joint positions, manipulation small moves of the targets, so that a grasp is held by
force and an untrained policy does not sweep the table; see docs/manipulation.md.
"""

from dataclasses import dataclass, field

import warp as wp

from spin_rl import robot
from spin_rl.sim.drive import DriveLimits

ABSOLUTE = wp.constant(0)
INCREMENTAL = wp.constant(1)
"""Values of a world's mode."""

_FINGER = wp.constant(robot.JOINTS.index("gripper_finger"))

wp.set_module_options({"enable_backward": False})


_LARGEST = 100.0
"""Of speeds, times and angles: more cannot be meant."""


@dataclass(frozen=True)
class IncrementConfig:
    """How far actions move the targets in the incremental mode.

    Attributes:
        joint_rate: How fast an action of 1 moves each target in `robot.JOINTS` order [m/s, rad/s], shape
            (8,); the gripper's is not used.
        lead_s: Targets stay within what they move in this time of where the joint is [s].
        gripper_middle: Target of the fingers for an action of 0 [rad].
        gripper_span: What an action of 1 adds to it [rad].
        gripper_lead: The fingers' targets stay within this of where they are [rad]; this sets the grip's
            force.
        forward_speed: Speed of the base for an action of 1 [m/s].
        turn_speed: Turning speed of the base for an action of 1 [rad/s].
    """

    joint_rate: tuple[float, ...] = (0.4, 0.4, 2.0, 1.5, 2.0, 0.0, 3.0, 3.0)
    lead_s: float = 0.2
    gripper_middle: float = 0.35
    gripper_span: float = 0.6
    gripper_lead: float = 0.24
    forward_speed: float = 0.2
    turn_speed: float = 0.4

    def __post_init__(self) -> None:
        """Reject values that cannot move the robot."""
        slowest, fastest = min(self.joint_rate, default=0.0), max(self.joint_rate, default=0.0)
        if len(self.joint_rate) != len(robot.JOINTS) or not 0.0 <= slowest <= fastest <= _LARGEST:
            raise ValueError(
                f"manipulation.joint_rate must be {len(robot.JOINTS)} numbers, none negative, "
                f"got {self.joint_rate}"
            )
        for name in ("lead_s", "gripper_span", "gripper_lead", "forward_speed", "turn_speed"):
            if not 0.0 < getattr(self, name) <= _LARGEST:
                raise ValueError(
                    f"manipulation.{name} must be positive, at most {_LARGEST:g}, got {getattr(self, name)}"
                )

    @property
    def joint_lead(self) -> tuple[float, ...]:
        """How far targets stay within where the joints are, in `robot.JOINTS` order [m, rad], shape (8,)."""
        finger = robot.JOINTS.index("gripper_finger")
        lead = [rate * self.lead_s for rate in self.joint_rate]
        return (*lead[:finger], self.gripper_lead, *lead[finger + 1 :])


@dataclass(frozen=True)
class ManipulationConfig:
    """A simulation with the grasping robot and an object.

    Attributes:
        increments: How actions move the joint targets.
    """

    increments: IncrementConfig = field(default_factory=IncrementConfig)


@wp.struct
class Increments:
    """`IncrementConfig` as the kernel reads it, for one control period."""

    step: wp.array[float]
    lead: wp.array[float]
    gripper_middle: float
    gripper_span: float
    forward_speed: float
    turn_speed: float


def make_increments(config: IncrementConfig, period: float, device: str) -> Increments:
    """Allocate the increments of a control period [s] on a device."""
    increments = Increments()
    increments.step = wp.array([rate * period for rate in config.joint_rate], dtype=float, device=device)
    increments.lead = wp.array(config.joint_lead, dtype=float, device=device)
    for name in ("gripper_middle", "gripper_span", "forward_speed", "turn_speed"):
        setattr(increments, name, getattr(config, name))
    return increments


@wp.func
def joint_target(a: float, low: float, default: float, high: float) -> float:
    """Map an action to a set-point: 0 is the default pose, -1 and 1 are the limits, linear in between."""
    if a >= 0.0:
        return default + a * (high - default)
    return default + a * (default - low)


@wp.func
def action_for(position: float, low: float, default: float, high: float) -> float:
    """Map a set-point to the action for it, not clipped: the inverse of `joint_target`."""
    offset = position - default
    if offset >= 0.0:
        span = high - default
    else:
        span = default - low
    return offset / wp.max(span, 1.0e-6)


@wp.func
def joint_position(
    w: int,
    joint: int,
    dof_joint: wp.array(dtype=wp.int32),
    dof_share: wp.array(dtype=float),
    qpos: wp.array2d(dtype=float),
) -> float:
    """Position of a joint of `robot.JOINTS`, from the degrees of freedom that share its motion."""
    moved = float(0.0)
    share = float(0.0)
    for dof in range(3, dof_joint.shape[0]):
        if dof_joint[dof] == joint:
            moved += qpos[w, dof]
            share += dof_share[dof]
    return moved / share


@wp.kernel
def _set_targets(
    # Model
    dof_joint: wp.array(dtype=wp.int32),
    dof_share: wp.array(dtype=float),
    joint_low: wp.array(dtype=float),
    joint_default: wp.array(dtype=float),
    joint_high: wp.array(dtype=float),
    base_speed: wp.array(dtype=float),
    increments: Increments,
    # Per world
    mode: wp.array(dtype=wp.int32),
    speed_scale: wp.array(dtype=float),
    action: wp.array2d(dtype=float),
    qpos: wp.array2d(dtype=float),
    # Out
    base_target_out: wp.array2d(dtype=float),
    target_out: wp.array2d(dtype=float),
) -> None:
    w = wp.tid()
    scale = speed_scale[w]
    forward = wp.clamp(action[w, 0], -1.0, 1.0)
    turn = wp.clamp(action[w, 1], -1.0, 1.0)
    if mode[w] == ABSOLUTE:
        base_target_out[w, 0] = scale * forward * wp.where(forward >= 0.0, base_speed[0], base_speed[1])
        base_target_out[w, 1] = scale * turn * base_speed[2]
        for joint in range(target_out.shape[1]):
            a = wp.clamp(action[w, joint + 2], -1.0, 1.0)
            target_out[w, joint] = joint_target(a, joint_low[joint], joint_default[joint], joint_high[joint])
        return
    base_target_out[w, 0] = scale * forward * increments.forward_speed
    base_target_out[w, 1] = scale * turn * increments.turn_speed
    for joint in range(target_out.shape[1]):
        a = wp.clamp(action[w, joint + 2], -1.0, 1.0)
        target = target_out[w, joint] + a * increments.step[joint]
        if joint == _FINGER:
            target = increments.gripper_middle + a * increments.gripper_span
        at = joint_position(w, joint, dof_joint, dof_share, qpos)
        target = wp.clamp(target, at - increments.lead[joint], at + increments.lead[joint])
        target_out[w, joint] = wp.clamp(target, joint_low[joint], joint_high[joint])


def set_targets(
    limits: DriveLimits,
    increments: Increments,
    *,
    mode: wp.array,
    speed_scale: wp.array,
    action: wp.array,
    qpos: wp.array,
    base_target: wp.array,
    target: wp.array,
) -> None:
    """Write the targets of one control step.

    Args:
        limits: The robot's limits.
        increments: Moves of the targets in the incremental mode.
        mode: `ABSOLUTE` or `INCREMENTAL`, shape (nworld,), int32.
        speed_scale: Factor on the base's speeds, shape (nworld,).
        action: Actions in [-1, 1] in `robot.ACTIONS` order (clipped here), shape (nworld, 10).
        qpos: Generalized positions, the robot's first, shape (nworld, 13 or more).
        base_target: Output, forward [m/s] and turning [rad/s] speed of the base, shape (nworld, 2).
        target: Joint targets in `robot.JOINTS` order [m or rad], shape (nworld, 8); updated in place.
    """
    wp.launch(
        _set_targets,
        dim=qpos.shape[0],
        inputs=[
            limits.dof_joint,
            limits.dof_share,
            limits.joint_low,
            limits.joint_default,
            limits.joint_high,
            limits.base_speed,
            increments,
            mode,
            speed_scale,
            action,
            qpos,
        ],
        outputs=[base_target, target],
        device=qpos.device,
    )
