# pyright: reportGeneralTypeIssues=false
# (to a type checker, a Warp struct is an object, not a class)
"""Parameters of the tabletop generator, on the host and as the struct that its kernel reads."""

from dataclasses import dataclass, fields
from functools import lru_cache

import warp as wp

from spin_rl import robot
from spin_rl.warp_kernels.structs import struct_of


@dataclass(frozen=True)
class TabletopParams:
    """Distribution of tables, objects and start poses. Pairs are (low, high) of a uniform draw.

    Lengths in metres, angles in radians. The nominal robot stands at the origin and faces +x; the table is
    on its right, at -y, where the arm extends to.

    Attributes:
        table_top: Height of the table's top.
        table_half_length: Half the table's size along x.
        table_half_depth: Half the table's size along y.
        table_yaw: Largest turn of the table, either way.
        edge_margin: Distance from the object to the table's edges, at least.
        object_distance: Distance of the object's centre to the robot's right.
        size_factor: Factor on the object's nominal size.
        mass_factor: Factor on its nominal mass.
        friction: Sliding friction of the fingertips' pads.
        base_x: Largest offset of the robot along x, either way.
        base_y: Likewise along y; where the gripper would be too close to the object, the robot stands
            farther away.
        base_yaw: Likewise its turn.
        start_above: Height of the gripper above the object at a start near its height.
        start_arm_extension: Arm extension at the start.
        start_wrist_yaw: Wrist yaw at the start.
        start_wrist_pitch: Wrist pitch at the start; down is negative.
        start_wrist_roll: Wrist roll at the start.
        start_gripper_finger: Finger angle at the start.
        start_head_pan: Bounds of the head pan at the start; inside of them it is drawn about the object.
        start_head_tilt: Likewise the head tilt.
        look_pan: Largest offset of the head pan from looking at the object, either way.
        look_tilt: Likewise of the head tilt.
        clearance: Distance of the gripper to table and object at starts that are not near.
        near_distance: How far the gripper is from the object's centre at near starts, along its direction.
        near_above: How far it is above the height to grasp at.
        near_finger: Finger angle at near starts.
        max_distractors: Most boxes placed around the robot, out of its reach.
        wall_share: Probability of each of four walls around it.
    """

    table_top: tuple[float, float] = (0.35, 0.95)
    table_half_length: tuple[float, float] = (0.2, 0.6)
    table_half_depth: tuple[float, float] = (0.15, 0.35)
    table_yaw: float = 0.1
    edge_margin: float = 0.02
    object_distance: tuple[float, float] = (0.57, 0.85)
    size_factor: tuple[float, float] = (0.9, 1.1)
    mass_factor: tuple[float, float] = (0.8, 1.2)
    friction: tuple[float, float] = (1.0, 1.4)
    base_x: float = 0.1
    base_y: float = 0.05
    base_yaw: float = 0.2
    start_above: tuple[float, float] = (0.0, 0.2)
    start_arm_extension: tuple[float, float] = (0.0, 0.1)
    start_wrist_yaw: tuple[float, float] = (-0.15, 0.15)
    start_wrist_pitch: tuple[float, float] = (-0.35, 0.05)
    start_wrist_roll: tuple[float, float] = (-0.15, 0.15)
    start_gripper_finger: tuple[float, float] = (0.1, 0.55)
    start_head_pan: tuple[float, float] = (-3.9, 1.5)
    start_head_tilt: tuple[float, float] = (-1.53, 0.79)
    look_pan: float = 1.2
    look_tilt: float = 0.6
    clearance: float = 0.03
    near_distance: tuple[float, float] = (-0.02, 0.12)
    near_above: tuple[float, float] = (0.0, 0.03)
    near_finger: float = 0.58
    max_distractors: int = 4
    wall_share: float = 0.5

    def __post_init__(self) -> None:
        """Reject values that cannot make a scene to pick from."""
        for field in fields(self):
            value = getattr(self, field.name)
            pair = value if isinstance(value, tuple) else (value, value)
            _require(
                len(pair) == 2 and pair[0] <= pair[1] and max(map(abs, pair)) <= _LARGEST,
                f"scene.{field.name} must be {'(low, high)' if pair is value else 'finite'}, at most "
                f"{_LARGEST:g}, got {value}",
            )
            if field.name not in _SIGNED:
                _require(pair[0] >= 0.0, f"scene.{field.name} must not be negative, got {value}")
        for name in ("size_factor", "mass_factor", "friction", "table_half_length"):
            _require(
                getattr(self, name)[0] > 0.0, f"scene.{name} must be positive, got {getattr(self, name)}"
            )
        for name, low, high in _LIMITS:
            value = getattr(self, name)
            pair = value if isinstance(value, tuple) else (value, value)
            _require(
                low <= pair[0] and pair[1] <= high, f"scene.{name} must lie in [{low}, {high}], got {value}"
            )


_LARGEST = 100.0
# Bounds within which starts are free of contact and objects within reach; joints have those of the robot.
_LIMITS = (
    ("table_top", 0.3, 1.0),
    ("table_half_depth", 0.13, 1.0),
    ("table_yaw", 0.0, 0.15),
    ("object_distance", 0.55, 0.87),
    ("size_factor", 0.5, 1.2),
    ("base_y", 0.0, 0.05),
    ("base_yaw", 0.0, 0.3),
    ("start_wrist_yaw", -0.3, 0.3),
    ("start_wrist_pitch", -0.5, 0.2),
    ("start_wrist_roll", -0.3, 0.3),
    ("wall_share", 0.0, 1.0),
    ("max_distractors", 0, 100),
    ("near_finger", robot.GRASP_FINGER_LOWER, 0.6),
    ("start_gripper_finger", robot.GRASP_FINGER_LOWER, 0.6),
    *(
        (f"start_{joint}", robot.JOINT_LOWER[i], robot.JOINT_UPPER[i])
        for i, joint in enumerate(robot.JOINTS)
        if joint in ("arm_extension", "head_pan", "head_tilt")
    ),
)
_SIGNED = (
    "near_distance",
    "near_finger",
    *(f"start_{joint}" for joint in robot.JOINTS if joint not in ("lift", "arm_extension")),
)


@wp.struct
class TabletopStruct:
    """`TabletopParams` as the kernel reads them."""

    table_top: wp.vec2
    table_half_length: wp.vec2
    table_half_depth: wp.vec2
    table_yaw: float
    edge_margin: float
    object_distance: wp.vec2
    size_factor: wp.vec2
    mass_factor: wp.vec2
    friction: wp.vec2
    base_x: float
    base_y: float
    base_yaw: float
    start_above: wp.vec2
    start_arm_extension: wp.vec2
    start_wrist_yaw: wp.vec2
    start_wrist_pitch: wp.vec2
    start_wrist_roll: wp.vec2
    start_gripper_finger: wp.vec2
    start_head_pan: wp.vec2
    start_head_tilt: wp.vec2
    look_pan: float
    look_tilt: float
    clearance: float
    near_distance: wp.vec2
    near_above: wp.vec2
    near_finger: float
    max_distractors: int
    wall_share: float


@lru_cache(maxsize=8)
def tabletop_struct(params: TabletopParams) -> TabletopStruct:
    """The kernel's copy of the parameters."""
    return struct_of(TabletopStruct, params)


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise ValueError(message)
