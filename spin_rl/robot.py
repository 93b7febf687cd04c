"""The Stretch RE1 in numbers: joints, actions, limits, speeds, servo constants, stowed pose, camera.

The one typed home of what the rest of the package needs to know about the robot, and so one file, most of it
tables; its shape and masses are in ``robots/stretch_re1/stretch_re1.xml``. Sources:
``robots/stretch_re1/README.md``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal

import numpy as np

from spin_rl.paths import ROBOT_XML

if TYPE_CHECKING:  # the robot's own computer has no MuJoCo, and needs the numbers only
    import mujoco

JOINTS = (
    "lift",
    "arm_extension",
    "wrist_yaw",
    "wrist_pitch",
    "wrist_roll",
    "gripper_finger",
    "head_pan",
    "head_tilt",
)
"""The 8 joints that a policy commands; lift and arm_extension in metres, the rest in radians."""

ACTIONS = ("base_forward", "base_turn", *JOINTS)
"""The 10 actions, each in [-1, 1] (paper, "Experimental Setup": 10 actuated joints)."""

CAMERA_JOINTS = ("head_pan", "head_tilt")
"""Of JOINTS, those that move the camera, the last two."""

DOF_NAMES = (
    "base_x",
    "base_y",
    "base_yaw",
    "lift",
    "arm_outer",
    "arm_inner",
    "wrist_yaw",
    "wrist_pitch",
    "wrist_roll",
    "finger_left",
    "finger_right",
    "head_pan",
    "head_tilt",
)
"""Joints of the MJCF in qpos, qvel and ctrl order."""

PARTS = ("base", "mast", "head", "arm", "wrist", "gripper")
"""Collision geoms are named ``<part>`` or ``<part>_<i>``."""

# (joint of JOINTS, share of it) for every entry of DOF_NAMES after the base: the telescope's two slides
# take half of the extension each, both fingers take the whole finger angle.
DOF_SOURCE: tuple[tuple[str, float], ...] = (
    ("lift", 1.0),
    ("arm_extension", 0.5),
    ("arm_extension", 0.5),
    ("wrist_yaw", 1.0),
    ("wrist_pitch", 1.0),
    ("wrist_roll", 1.0),
    ("gripper_finger", 1.0),
    ("gripper_finger", 1.0),
    ("head_pan", 1.0),
    ("head_tilt", 1.0),
)

JOINT_LOWER = (0.0, 0.0, -1.75, -1.57, -3.14, -0.6, -3.9, -1.53)
JOINT_UPPER = (1.1, 0.52, 4.0, 0.56, 3.14, 0.6, 1.5, 0.79)
"""Joint limits in JOINTS order [m, rad]."""

WHEEL_SEPARATION_M = 0.3407

GRASP_CENTER_SITE = "link_grasp_center"
CAMERA_SITE = "camera_depth_optical_frame"
"""Site between the fingertips; its x axis points out of the gripper, towards what it reaches for."""

HAND_Z_M, HAND_AHEAD_M, HAND_BELOW_M = 0.1395, 0.264359, 0.024
"""At the zero pose, height of the wrist's pitch joint, and the grasp centre from there, by the MJCF."""

BASE_X_M, BASE_HALF_WIDTH_M, BASE_TOP_M = (-0.288, 0.059), 0.182, 0.20
"""The base's box in its own frame, with the laser on top."""

HEAD_X_M, HEAD_Z_M = 0.0061, 1.36
"""The head's pan axis in the base frame, and about how high the camera is."""

STOWED: Mapping[str, float] = MappingProxyType(
    {
        "lift": 0.35,
        "arm_extension": 0.0,
        "wrist_yaw": 3.05,
        "wrist_pitch": -0.6,
        "wrist_roll": 0.0,
        "gripper_finger": 0.0,
        "head_pan": 0.0,
        "head_tilt": -0.6,
    }
)
"""The pose to drive in: the gripper folded back over the base.

Chosen among wrist yaws 1.6 to 3.4 and pitches -1.57 to 0.5 by the collision geoms' footprint. All of them
lie within the base box (x -0.288 to 0.060 m, y -0.182 to 0.183 m) but for 9 mm on the right (wrist, gripper)
and 6 mm in front (wrist); the farthest point from the wheel axis' middle is the base's own rear corner,
0.341 m. The hand clears the mast by 26 mm and the base by 96 mm. A level gripper (pitch 0) would hit the
mast at every yaw that keeps it above the base.
"""

PADS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {"finger_left": ("gripper_3", "gripper_4"), "finger_right": ("gripper_5", "gripper_6")}
)
"""Geoms of the grasping robot's fingertips, by body: two spheres above each other (see `load_grasp_spec`)."""

OBJECT_CONTYPE = 8
"""Contact bit of objects to be grasped."""

PAD_RADIUS_M = 0.012
_PAD_Z_M = 0.012
_PAD_SPIN_M = 0.01
"""Torsional friction: what a rubber disc of 15 mm radius under even pressure has, 2/3 of its radius."""

_PAD_XY_M = (0.0064, -0.1906)
"""Middle of the left fingertip's pads in the finger's frame; the right one's is the mirror image in x."""

GRASP_FINGER_LOWER = -0.05
"""Lower limit of the grasping robot's fingers [rad]; there the pads are 6 mm apart, and they cross below."""


@dataclass(frozen=True)
class Servo:
    """A velocity servo of the grasping robot.

    Attributes:
        gain: Force per velocity error [N s/m, N m s/rad].
        force_max: Largest force or torque [N, N m].
        armature: Inertia that the motor adds to the joint [kg m^2], None to leave it.
    """

    gain: float
    force_max: float
    armature: float | None = None


GRASP_SERVOS: Mapping[str, Servo] = MappingProxyType(
    {
        "lift": Servo(300.0, 120.0),
        "arm_outer": Servo(400.0, 60.0),
        "arm_inner": Servo(400.0, 60.0),
        "wrist_yaw": Servo(5.0, 6.0, 0.05),
        "wrist_pitch": Servo(5.0, 6.0, 0.05),
        "wrist_roll": Servo(5.0, 4.0, 0.05),
        "finger_left": Servo(2.0, 3.0, 0.02),
        "finger_right": Servo(2.0, 3.0, 0.02),
    }
)
"""Soft servos, without which grasped objects slip; see docs/manipulation.md. Both slides of the telescope are
in series, so that the arm as a whole is half as stiff as each."""

CAMERA_FOV_DEG = (87.0, 58.0)
"""Depth field of view of the Intel D435i along the sensor's long and short side."""

CameraMount = Literal["portrait", "landscape"]


@dataclass(frozen=True)
class SpeedProfile:
    """How fast the robot may move.

    Attributes:
        forward_max: Largest forward speed of the base [m/s].
        reverse_max: Largest backward speed of the base, a positive number [m/s].
        turn_max: Largest turning speed either way [rad/s].
        base_acceleration: Largest change of the base's speed [m/s^2].
        joint_velocity_max: Largest joint speeds in JOINTS order, shape (8,) [m/s, rad/s].
        joint_time_constant: First-order time constant of every joint servo [s].
        base_time_constant: First-order time constant of the base's two speeds [s].
    """

    forward_max: float
    reverse_max: float
    turn_max: float
    base_acceleration: float
    joint_velocity_max: tuple[float, ...]
    joint_time_constant: float = 0.1
    base_time_constant: float = 0.15

    @property
    def turn_acceleration(self) -> float:
        """Turning acceleration when the wheels reach ``base_acceleration`` oppositely [rad/s^2]."""
        return 2.0 * self.base_acceleration / WHEEL_SEPARATION_M


SPEED_PROFILES: Mapping[str, SpeedProfile] = MappingProxyType(
    {
        # Faster than the stock robot: the paper gives no limits, so these are this project's choice.
        "paper": SpeedProfile(0.8, 0.1, 1.5, 2.0, (0.4, 0.5, 3.0, 3.0, 4.5, 1.5, 7.0, 6.0)),
        # As fast backwards as ahead, for scenes in which the robot cannot turn round; slow enough to look.
        "reversing": SpeedProfile(0.4, 0.4, 1.5, 2.0, (0.4, 0.5, 3.0, 3.0, 4.5, 1.5, 7.0, 6.0)),
        # The stock robot's.
        "re1": SpeedProfile(0.3, 0.1, 1.0, 0.4, (0.15, 0.3, 3.0, 3.0, 4.5, 1.5, 7.0, 6.0)),
    }
)


def qpos_from_joints(model: mujoco.MjModel, joints: Mapping[str, float]) -> np.ndarray:
    """Return the ``qpos`` of a joint pose, the base at the origin.

    Args:
        model: A model that contains the robot; its other joints stay at ``model.qpos0``.
        joints: A value for every name in JOINTS [m, rad], within the limits.

    Returns:
        Array of shape (model.nq,).

    Raises:
        ValueError: A key is unknown or missing, or a value is not finite or outside its limits.
    """
    unknown = sorted(set(joints) - set(JOINTS))
    if unknown:
        raise ValueError(f"unknown joint {unknown[0]!r}; the joints are {', '.join(JOINTS)}")
    for name, lower, upper in zip(JOINTS, JOINT_LOWER, JOINT_UPPER, strict=True):
        if name not in joints:
            raise ValueError(f"joint {name!r} is missing")
        if not lower <= joints[name] <= upper:  # also catches NaN
            raise ValueError(f"joint {name!r} is {joints[name]}, outside [{lower}, {upper}]")
    qpos = model.qpos0.copy()
    for dof in DOF_NAMES[:3]:
        qpos[model.joint(dof).qposadr[0]] = 0.0
    for dof, (joint, share) in zip(DOF_NAMES[3:], DOF_SOURCE, strict=True):
        qpos[model.joint(dof).qposadr[0]] = share * joints[joint]
    return qpos


def action_of(joint: str, position: float) -> float:
    """Return the action in [-1, 1] whose set-point is a joint position [m or rad].

    Actions are piecewise linear: -1 and 1 are the joint's limits, 0 is its stowed position.
    """
    index = JOINTS.index(joint)
    offset = position - STOWED[joint]
    bound = JOINT_UPPER[index] if offset >= 0.0 else JOINT_LOWER[index]
    span = abs(bound - STOWED[joint])
    return offset / span if span > 0.0 else 0.0


def camera_tan_half_fov(mount: CameraMount) -> tuple[float, float]:
    """Return the tangents of half the depth camera's field of view along its optical x and y axes.

    Args:
        mount: ``portrait``, as on the robot (87 degrees along the optical x axis, which points down in the
            world), or ``landscape`` (58 degrees there, 87 across: the paper's text).

    Raises:
        ValueError: The mount is neither.
    """
    long_side, short_side = (math.tan(math.radians(fov) / 2) for fov in CAMERA_FOV_DEG)
    return (long_side, short_side) if is_portrait(mount) else (short_side, long_side)


def is_portrait(mount: CameraMount) -> bool:
    """Return whether a camera's mount is ``portrait`` and not ``landscape``.

    Raises:
        ValueError: It is neither.
    """
    if mount not in ("portrait", "landscape"):
        raise ValueError(f"camera mount {mount!r} is neither 'portrait' nor 'landscape'")
    return mount == "portrait"


def load_spec() -> mujoco.MjSpec:
    """Return a fresh, editable specification of the robot alone (no floor, no scene)."""
    import mujoco

    return mujoco.MjSpec.from_file(str(ROBOT_XML))


def load_grasp_spec() -> mujoco.MjSpec:
    """Return a fresh specification of the robot that can grasp: soft servos and fingertips of two spheres.

    It differs from `load_spec` in contacts and servos alone. The fingers' 3 cm capsules become as thin as the
    drawn ones and pass through objects; the fingertips' pads, which are drawn as well, hold them. Geoms that
    meet objects have bit 8 (`OBJECT_CONTYPE`) in their affinity.
    """
    import mujoco

    spec = load_spec()
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0
    for body, side in (("finger_left", 1.0), ("finger_right", -1.0)):
        _add_pads(spec.body(body), side)
        finger = spec.geom("gripper_1" if side > 0.0 else "gripper_2")
        finger.size[0] = 0.01
        finger.fromto = [side * 0.008, -0.01, 0.0, side * 0.0135, -0.185, 0.0]
        spec.joint(body).range = [GRASP_FINGER_LOWER, JOINT_UPPER[JOINTS.index("gripper_finger")]]
    for name in ("base", "arm_3", "arm_4", "wrist", "gripper"):
        spec.geom(name).conaffinity |= OBJECT_CONTYPE
    for name, servo in GRASP_SERVOS.items():
        actuator, joint = spec.actuator(name), spec.joint(name)
        actuator.gainprm[0] = servo.gain
        actuator.biasprm[2] = -servo.gain
        actuator.forcerange = [-servo.force_max, servo.force_max]
        if servo.armature is not None:
            joint.armature = servo.armature
    return spec


def _add_pads(finger: mujoco.MjsBody, side: float) -> None:
    import mujoco

    x, y = _PAD_XY_M
    for name, z in zip(PADS[finger.name], (-_PAD_Z_M, _PAD_Z_M), strict=True):
        finger.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[PAD_RADIUS_M, 0.0, 0.0],
            pos=[side * x, y, z],
            contype=4,
            conaffinity=3 | OBJECT_CONTYPE,
            condim=4,
            friction=[1.2, _PAD_SPIN_M, 1e-4],
            group=2,
            rgba=[0.3, 0.3, 0.32, 1.0],
        )
