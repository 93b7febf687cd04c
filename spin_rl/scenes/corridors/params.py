"""Parameters of the corridor generator and what of them is possible."""

from dataclasses import dataclass, fields

from spin_rl import robot
from spin_rl.scenes.layout import PoolSpec

HIDDEN_DEPTH_M = 0.03
"""How deep inside its wall an obstacle waits; a wall hides what lies 15 mm behind its face."""

_LARGEST = 1000.0
"""Of any parameter [m, rad, m/s]: more cannot be meant."""

# How far the driving robot, arm stowed, extends ahead of its origin, with a margin.
_REACH_M = 0.4
_FASTEST_M_S = max(profile.forward_max for profile in robot.SPEED_PROFILES.values())


@dataclass(frozen=True)
class GeneratorParams:
    """Distribution of corridors, clutter and start poses. Pairs are (low, high) of a uniform draw.

    Lengths in metres, angles in radians. "Across" is measured from a side wall towards the other one, "along"
    along the path from start to goal.

    Attributes:
        width: Corridor width at curriculum level 1.
        easy_width: Corridor width at curriculum level 0.
        length: Path length from start to goal.
        first_leg: Length of the first leg of an L, from the start to the corner's centre.
        behind_start: Room behind the start.
        beyond_goal: Room beyond the goal.
        wall_height: Height of the walls, one draw per world.
        wall_thickness: Thickness of the walls.
        passage: Room left beside every obstacle; the base is 0.363 m wide, 0.374 m with the stowed arm.
        first_obstacle: Distance from the robot's front, as it faces the goal, to the nearest possible
            obstacle.
        goal_clearance: Distance from the last possible obstacle to the goal.
        corner_clearance: Distance of obstacles along the first leg to the corner's square.
        slalom_gap: Distance along between obstacles on opposite sides that cannot be passed in a straight
            line.
        slalom_gain: What that distance grows by per metre that the robot must shift across.
        same_side_gap: Smallest distance along between any two obstacles.
        tall_share: Share of obstacles that stand on the floor and are tall.
        arm_share: Share of floating obstacles at arm height.
        head_share: Share of floating obstacles at head height; low floor obstacles are the rest.
        cylinder_share: Share of floor obstacles that are cylinders.
        standing_share: Share of boxes that stand away from the wall, where enough room remains.
        corner_share: Share of L-shaped corridors whose first obstacle after the corner is hidden behind it.
        hard_obstacles: Obstacles of a hard corridor.
        protrusion: How far an obstacle reaches into the corridor, further limited by `passage`.
        standing_width: Size across of boxes that stand away from the wall.
        half_length: Half the size along of boxes.
        radius: Radius of cylinders.
        box_yaw: Largest turn of a box against the corridor, either way.
        low_top: Top of low floor obstacles.
        tall_top: Top of tall floor obstacles.
        arm_bottom: Bottom of obstacles at arm height.
        arm_thickness: Height of the body of obstacles at arm height.
        head_bottom: Bottom of obstacles at head height.
        head_thickness: Height of the body of obstacles at head height.
        max_distractors: Most boxes placed outside the walls; at least one, but for 0.
        emerging_share: Share of obstacles that stay inside their wall until the base comes near.
        patrolling_share: Share of obstacles that slide to and fro all the time.
        emerging_trigger: Distance of the base at which an obstacle starts to come out of its wall.
        motion_speed: Speed of obstacles that move [m/s].
        start_y: Largest offset of the start from the corridor's centre line, either way.
        start_clearance: Smallest distance of the start pose to anything.
        start_tries: Start poses drawn before the aligned, stowed one is taken.
        start_lift: Lift positions at the start.
        start_arm_extension: Arm extensions at the start.
        start_wrist_yaw: Wrist yaw at the start, relative to the stowed one.
        start_wrist_pitch: Wrist pitch at the start, relative to the stowed one.
        start_wrist_roll: Wrist roll at the start, relative to the stowed one.
        start_gripper_finger: Finger angle at the start, relative to the stowed one.
        start_head_pan: Head pan at the start.
        start_head_tilt: Head tilt at the start.
    """

    width: float = 1.0
    easy_width: float = 1.6
    length: float = 5.0
    first_leg: tuple[float, float] = (2.0, 3.0)
    behind_start: tuple[float, float] = (0.55, 0.9)
    beyond_goal: tuple[float, float] = (0.5, 0.9)
    wall_height: tuple[float, float] = (1.0, 2.0)
    wall_thickness: float = 0.1
    passage: float = 0.5
    first_obstacle: float = 0.4
    goal_clearance: float = 0.35
    corner_clearance: float = 0.08
    slalom_gap: float = 0.45
    slalom_gain: float = 1.0
    same_side_gap: float = 0.05
    tall_share: float = 0.10
    arm_share: float = 0.15
    head_share: float = 0.30
    cylinder_share: float = 0.3
    standing_share: float = 0.3
    corner_share: float = 0.5
    hard_obstacles: int = 5
    protrusion: tuple[float, float] = (0.12, 0.6)
    standing_width: tuple[float, float] = (0.12, 0.3)
    half_length: tuple[float, float] = (0.05, 0.2)
    radius: tuple[float, float] = (0.05, 0.14)
    box_yaw: float = 0.15
    low_top: tuple[float, float] = (0.08, 0.25)
    tall_top: tuple[float, float] = (0.7, 1.4)
    arm_bottom: tuple[float, float] = (0.4, 0.8)
    arm_thickness: tuple[float, float] = (0.1, 0.3)
    head_bottom: tuple[float, float] = (1.05, 1.25)
    head_thickness: tuple[float, float] = (0.2, 0.4)
    max_distractors: int = 2
    emerging_share: float = 0.0
    patrolling_share: float = 0.0
    emerging_trigger: tuple[float, float] = (1.3, 1.9)
    motion_speed: tuple[float, float] = (0.8, 1.2)
    start_y: float = 0.15
    start_clearance: float = 0.05
    start_tries: int = 16
    start_lift: tuple[float, float] = (0.35, 0.9)
    start_arm_extension: tuple[float, float] = (0.0, 0.15)
    start_wrist_yaw: tuple[float, float] = (-1.2, 0.0)
    start_wrist_pitch: tuple[float, float] = (-0.15, 0.15)
    start_wrist_roll: tuple[float, float] = (-0.3, 0.3)
    start_gripper_finger: tuple[float, float] = (-0.1, 0.15)
    start_head_pan: tuple[float, float] = (-3.8, 1.4)
    start_head_tilt: tuple[float, float] = (-1.45, 0.6)

    def __post_init__(self) -> None:
        """Reject values that cannot make a solvable corridor."""
        for field in fields(GeneratorParams):
            value = getattr(self, field.name)
            pair = value if isinstance(value, tuple) else (value, value)
            what = "(low, high)" if pair is value else "a number"
            _require(
                len(pair) == 2 and pair[0] <= pair[1] and max(map(abs, pair)) <= _LARGEST,
                f"scene.{field.name} must be {what} of at most {_LARGEST:g}, got {value}",
            )
            _require(
                field.name in START_RANGES or pair[0] >= 0.0,
                f"scene.{field.name} must not be negative, got {value}",
            )
        for name in (
            "wall_thickness",
            "first_obstacle",
            "goal_clearance",
            "corner_clearance",
            "same_side_gap",
        ):
            _require(getattr(self, name) > 0.0, f"scene.{name} must be positive, got {getattr(self, name)}")
        _require(self.passage >= 0.42, f"scene.passage must be at least 0.42 m, got {self.passage}")
        _require(
            self.passage + self.protrusion[0] <= self.width <= self.easy_width,
            "scene.width must leave passage + protrusion[0] and not exceed easy_width, got "
            f"{self.width} with easy_width {self.easy_width}",
        )
        _require(
            self.first_leg[0] >= 0.5 * self.easy_width + 1.0
            and self.first_leg[1] <= self.length - 0.5 * self.easy_width - 0.9,
            f"scene.first_leg must leave room in both legs, got {self.first_leg} with length {self.length}",
        )
        _require(
            self.behind_start[0] >= 0.35 + self.start_clearance,
            f"scene.behind_start must leave room to turn, got {self.behind_start}",
        )
        _require(
            self.beyond_goal[0] >= 0.2, f"scene.beyond_goal must be at least 0.2, got {self.beyond_goal}"
        )
        _require(0.0 <= self.box_yaw <= 0.3, f"scene.box_yaw must be in [0, 0.3] rad, got {self.box_yaw}")
        for name in ("protrusion", "standing_width", "half_length", "radius", "low_top", "tall_top"):
            _require(
                getattr(self, name)[0] > 0.0, f"scene.{name} must be positive, got {getattr(self, name)}"
            )
        for name, low, high in (("max_distractors", 0, PoolSpec().num_boxes), ("start_tries", 1, 1000)):
            value = getattr(self, name)
            _require(
                low <= value <= high, f"scene.{name} must be at least {low} and at most {high}, got {value}"
            )
        for name in ("cylinder_share", "standing_share", "corner_share"):
            _require(
                0.0 <= getattr(self, name) <= 1.0,
                f"scene.{name} must be in [0, 1], got {getattr(self, name)}",
            )
        shares = (self.tall_share, self.arm_share, self.head_share)
        _require(
            min(shares) >= 0.0 and sum(shares) <= 1.0,
            f"scene.tall_share, arm_share, head_share must be at least 0 and sum to at most 1, got {shares}",
        )
        most = PoolSpec().num_boxes
        _require(
            4 <= self.hard_obstacles <= most,
            f"scene.hard_obstacles must be in [4, {most}], got {self.hard_obstacles}",
        )
        self._check_motion()
        for name, joint in START_RANGES.items():
            if name in ABSOLUTE_RANGES:
                index = robot.JOINTS.index(joint)
                low, high = robot.JOINT_LOWER[index], robot.JOINT_UPPER[index]
                value = getattr(self, name)
                _require(
                    low <= value[0] and value[1] <= high,
                    f"scene.{name} must lie within the joint's limits ({low}, {high}), got {value}",
                )

    @property
    def moves(self) -> bool:
        """Whether any obstacle can move."""
        return self.emerging_share > 0.0 or self.patrolling_share > 0.0

    def _check_motion(self) -> None:
        shares = (self.emerging_share, self.patrolling_share)
        _require(
            min(shares) >= 0.0 and sum(shares) <= 1.0,
            f"scene.emerging_share, patrolling_share must be at least 0 and sum to at most 1, got {shares}",
        )
        slowest = self.motion_speed[0]
        _require(slowest > 0.0, f"scene.motion_speed must be positive, got {self.motion_speed}")
        # An obstacle shall be out of its wall before even the fastest robot is beside it.
        way_out = min(self.protrusion[1], self.easy_width - self.passage) + HIDDEN_DEPTH_M
        needed = _REACH_M + self.half_length[1] + _FASTEST_M_S * way_out / slowest
        _require(
            self.emerging_share == 0.0 or self.emerging_trigger[0] >= needed,
            f"scene.emerging_trigger must be at least {needed:.2f} for scene.motion_speed from {slowest}, "
            f"got {self.emerging_trigger}",
        )


START_RANGES = {f"start_{joint}": joint for joint in robot.JOINTS}
"""Ranges of the start pose by parameter, in the order of `robot.JOINTS`."""

ABSOLUTE_RANGES = ("start_lift", "start_arm_extension", "start_head_pan", "start_head_tilt")
"""Those that are not relative to the stowed pose."""


def start_ranges(params: GeneratorParams) -> tuple[list[float], list[float]]:
    """Lowest and highest joint positions of a start, absolute and within the limits, `robot.JOINTS` order."""
    ranges = []
    for (name, joint), lower, upper in zip(
        START_RANGES.items(), robot.JOINT_LOWER, robot.JOINT_UPPER, strict=True
    ):
        offset = 0.0 if name in ABSOLUTE_RANGES else robot.STOWED[joint]
        ranges.append([min(max(bound + offset, lower), upper) for bound in getattr(params, name)])
    return [low for low, _ in ranges], [high for _, high in ranges]


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise ValueError(message)
