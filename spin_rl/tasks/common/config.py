"""What tasks have in common: one dataclass per group of settings, with the defaults of the code."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Annotated, get_args

from spin_rl import robot
from spin_rl.config import Choice
from spin_rl.sensors.depth.pipeline import DepthConfig
from spin_rl.sensors.noisy_map import MapConfig
from spin_rl.sim.config import SimConfig

CameraMount = Annotated[robot.CameraMount, Choice(get_args(robot.CameraMount))]

_UNITS = ("_m", "_s", "_n")
LARGEST_WITH_UNIT = 10_000.0
"""Of lengths [m], times [s] and forces [N]: more cannot be meant."""
_MOST_NOISE = 100.0
_MOST_LAG = 100.0


def require_positive(config: object, path: str, names: Iterable[str] | None = None) -> None:
    """Reject lengths, times and forces that are none.

    Args:
        config: A dataclass.
        path: Where it stands in the configuration, for messages.
        names: Fields to check; None takes all numbers whose name ends with a unit.

    Raises:
        ValueError: One of them is not positive or not finite.
    """
    with_unit = (n for n, v in vars(config).items() if n.endswith(_UNITS) and isinstance(v, int | float))
    for name in with_unit if names is None else names:
        value = getattr(config, name)
        if not 0.0 < value < math.inf:
            raise ValueError(f"{path}.{name} must be positive, got {value}")
        if value > LARGEST_WITH_UNIT:
            raise ValueError(f"{path}.{name} must be at most {LARGEST_WITH_UNIT:g}, got {value}")


@dataclass(frozen=True)
class CurriculumConfig:
    """How the training level of a world moves with its episodes.

    Attributes:
        enabled: Whether levels move; otherwise every world stays at `start`.
        start: Level of a new world in [0, 1]; 1 is the benchmark's corridor.
        up: Step up after a success.
        down: Step down after a failure.
    """

    enabled: bool = True
    start: float = 0.0
    up: float = 0.1
    down: float = 0.05

    def __post_init__(self) -> None:
        """Reject levels and steps outside [0, 1]."""
        for name in ("start", "up", "down"):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise ValueError(f"task.curriculum.{name} must be in [0, 1], got {value}")


@dataclass(frozen=True)
class DynamicsConfig:
    """Ranges of the servo parameters drawn at the start of each episode.

    Attributes:
        base_lag_s: Time constant of the base velocity [s].
        joint_lag_s: Time constant of the joints [s].
        speed_scale: Factor on all speed limits.
        acceleration_scale: Factor on the base's acceleration limits.
    """

    base_lag_s: tuple[float, float] = (0.1, 0.2)
    joint_lag_s: tuple[float, float] = (0.08, 0.15)
    speed_scale: tuple[float, float] = (0.8, 1.0)
    acceleration_scale: tuple[float, float] = (1.0, 1.0)

    def __post_init__(self) -> None:
        """Reject ranges that the servos cannot have."""
        for name in ("base_lag_s", "joint_lag_s", "speed_scale", "acceleration_scale"):
            low, high = getattr(self, name)
            if not 0.0 < low <= high <= _MOST_LAG:
                raise ValueError(
                    f"task.dynamics.{name} must be 0 < low <= high <= {_MOST_LAG:g}, got [{low}, {high}]"
                )


@dataclass(frozen=True)
class ProprioNoise:
    """Sensor noise of the proprio group in training, standard deviations of zero-mean normal noise.

    Attributes:
        joint_position: In units of the normalized position.
        joint_velocity: In units of the normalized velocity.
        base_velocity: [m/s, rad/s].
    """

    joint_position: float = 0.0
    joint_velocity: float = 0.0
    base_velocity: float = 0.0

    def __post_init__(self) -> None:
        """Reject negative noise."""
        for name, value in vars(self).items():
            if not 0.0 <= value <= _MOST_NOISE:
                raise ValueError(
                    f"task.noise.{name} must not be negative nor above {_MOST_NOISE:g}, got {value}"
                )


@dataclass(frozen=True)
class ScandotsConfig:
    """What the camera can see of the obstacles' corners.

    Attributes:
        window_m: Half side of the square local window around the base [m] (paper, Implementation Details:
            2 m).
        near_m: Smallest depth that the camera sees [m].
        occlusion: Whether obstacles hide corners behind them, as they do in a depth image.
        pieces_from_m: Slots longer or higher than this are told by the piece of them that is seen, as walls
            are [m]; None tells of walls alone so, and of the others by their corners (paper).
    """

    window_m: float = 2.0
    near_m: float = 0.1
    occlusion: bool = True
    pieces_from_m: float | None = None

    def __post_init__(self) -> None:
        """Reject lengths that are none."""
        require_positive(self, "task.scandots")


def check_head_pose(key: str, pose: Sequence[float]) -> None:
    """Reject a head pose (pan, tilt) [rad] beyond the joints' limits; an empty one is none.

    Raises:
        ValueError: One line that names the key.
    """
    for joint, value in zip(robot.CAMERA_JOINTS, pose, strict=False):
        index = robot.JOINTS.index(joint)
        if not robot.JOINT_LOWER[index] <= value <= robot.JOINT_UPPER[index]:
            raise ValueError(f"{key}: {value} is outside the limits of {joint}")


@dataclass(frozen=True)
class TaskConfig:
    """What every task has.

    Attributes:
        robot_profile: Key of `robot.SPEED_PROFILES`.
        camera_mount: "portrait" (as built) or "landscape" (the paper's text).
        camera_pose: Head pan and tilt [rad] at which the camera is frozen, whatever the policy asks for
            (paper, FixCam); None leaves the camera to the policy.
        episode_s: Time limit of an episode [s].
        reward: Scale of each reward term.
        depth: Noise and filter of the depth camera; None renders no images.
        curriculum: Movement of the training level.
        dynamics: Randomization of servos.
        sim: Physics options.
    """

    robot_profile: str = "paper"
    camera_mount: CameraMount = "portrait"
    camera_pose: tuple[float, float] | None = None
    episode_s: float = 30.0
    reward: dict[str, float] = field(default_factory=dict)
    depth: DepthConfig | None = None
    curriculum: CurriculumConfig = field(default_factory=CurriculumConfig)
    dynamics: DynamicsConfig = field(default_factory=DynamicsConfig)
    sim: SimConfig = field(default_factory=SimConfig)

    def __post_init__(self) -> None:
        """Reject impossible values with the key's name."""
        if self.robot_profile not in robot.SPEED_PROFILES:
            raise ValueError(f"robot: unknown profile {self.robot_profile!r}")
        check_head_pose("task.camera_pose", self.camera_pose or ())
        if not self.sim.control_period < self.episode_s < math.inf:
            raise ValueError(f"task.episode_s must exceed one control step, got {self.episode_s}")
        require_positive(self, "task")


@dataclass(frozen=True)
class CorridorConfig(TaskConfig):
    """What tasks in corridors have.

    Attributes:
        goal_tolerance_m: Distance at which the goal is reached [m] (paper, Real-world results: 15 cm).
        goal_range_m: Farthest that a goal is shown to the policy [m], in its direction; None: where it is.
        scenario: 1 straight, 2 L-shaped, 0 a mix of both.
        difficulty: 0 easy, 1 medium, 2 hard, -1 a mix limited by the curriculum.
        scandots: What the camera sees of obstacles.
        map: A noisy map as an observation group (paper, baseline Mapping).
    """

    goal_tolerance_m: float = 0.15
    goal_range_m: float | None = None
    scenario: int = 0
    difficulty: int = -1
    scandots: ScandotsConfig = field(default_factory=ScandotsConfig)
    map: MapConfig = field(default_factory=MapConfig)

    def __post_init__(self) -> None:
        """Reject impossible values with the key's name."""
        super().__post_init__()
        if self.scenario not in (0, 1, 2):
            raise ValueError(f"task.scenario must be 0, 1 or 2, got {self.scenario}")
        if self.difficulty not in (-1, 0, 1, 2):
            raise ValueError(f"task.difficulty must be -1, 0, 1 or 2, got {self.difficulty}")
