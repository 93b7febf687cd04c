"""What defines the navigation task, with the defaults of the code."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from spin_rl.config import Choice, ConfigError, Range
from spin_rl.planning.distance_field import GridSpec
from spin_rl.scenes.corridors.params import GeneratorParams
from spin_rl.sensors.lidar import LidarConfig
from spin_rl.sensors.odometry import OdometryConfig
from spin_rl.tasks.common.config import CorridorConfig, ProprioNoise, check_head_pose, require_positive
from spin_rl.tasks.common.rewards import check_scales
from spin_rl.tasks.nav.rewards import TERMS

CAMERA_ACTIONS = ("target", "rate", "gaze")
"""What the camera's actions may say."""


@dataclass(frozen=True)
class NavNoise(ProprioNoise):
    """Sensor noise in training, standard deviations of zero-mean normal (scandots: uniform) noise.

    Attributes:
        goal_m: Of the goal's x and y [m].
        scandots_m: Half width of the uniform noise on every scandot coordinate [m].
    """

    goal_m: float = 0.0
    scandots_m: float = 0.0


@dataclass(frozen=True)
class GuardConfig:
    """A guard between policy and base: it replaces commands that would drive into what was seen.

    Attributes:
        enabled: Whether there is one.
        look_ahead_s: Time that a command is tried for before it brakes [s].
        margin_m: Distance that counts as a collision [m].
        lag_s: Time constant that the base is expected to have [s].
        memory_s: Time after which what was not seen again is forgotten, what moves after 10 s at most [s].
        foresee_s: Time that what moves is expected to go on, to get out of its way [s]; 0: never.
    """

    enabled: bool = False
    look_ahead_s: Annotated[float, Range(0.0, 2.0, above=True)] = 0.5
    margin_m: Annotated[float, Range(0.0, 0.5)] = 0.03
    lag_s: float = 0.2
    memory_s: float = 120.0
    foresee_s: Annotated[float, Range(0.0, 5.0)] = 3.0

    def __post_init__(self) -> None:
        """Reject times that are none."""
        require_positive(self, "task.guard", ("lag_s", "memory_s"))


@dataclass(frozen=True)
class PlannerConfig:
    """A planner over what was seen: the policy gets a point of the way to the goal for the goal.

    It needs the guard, which drives by its ways where the robot is stuck.

    Attributes:
        enabled: Whether there is one.
        ahead_m: How far along the way the point is [m].
        replan_s: Shortest time between plans in an episode [s].
        stuck_s: Time without leaving a place after which a robot is stuck that the guard keeps from its
            commands [s]; others are after twice the time.
        clearance_m: Distance to obstacles from which a way costs no more than its length [m].
        blocked_m: Distance below which no way leads through [m].
        cell_m: Side of a cell of its map [m].
        size_m: Side of its map, which lies around start and goal [m].
    """

    enabled: bool = False
    ahead_m: Annotated[float, Range(0.3, 10.0)] = 2.0
    replan_s: float = 0.5
    stuck_s: float = 1.5
    clearance_m: Annotated[float, Range(0.0, 2.0)] = 0.25
    blocked_m: Annotated[float, Range(0.0, 1.0)] = 0.16
    cell_m: Annotated[float, Range(0.02, 0.3)] = 0.15
    size_m: Annotated[float, Range(2.0, 100.0)] = 15.0

    def __post_init__(self) -> None:
        """Reject times that are none, and distances that cells cannot tell."""
        require_positive(self, "task.planner", ("replan_s", "stuck_s"))
        least = GridSpec.square(self.size_m, self.cell_m).blocked_m
        if self.blocked_m < least:
            raise ConfigError(f"task.planner.blocked_m: must be at least {least:.3f} with these cells")


@dataclass(frozen=True)
class NavConfig(CorridorConfig):
    """Everything that defines the navigation task.

    Attributes:
        camera_action: What the camera's two actions say: "target", where the head goes, or "rate", how fast
            its target moves, 1 being the head's largest speed. Or "gaze": nothing, the camera goes to
            `gaze_poses` in turn, or looks where one looks that knows what it has not shown yet
            (`sensors.gaze`), which no robot can know.
        camera_frozen_after_s: Time in an episode from which on the head stays where it was sent by then
            [s]; None lets it move. `camera_pose` goes before both.
        teach_gaze: Whether the camera follows the gaze, as with the action "gaze", and a group `gaze` says
            that for a policy to imitate; with camera actions that are targets.
        gaze_poses: Head poses (pan, tilt) that the gaze takes in turn [rad] (`sensors.patrol`); none of them
            and it looks for unknown things (`sensors.gaze`).
        stop_on_collision: Whether touching the scene ends the episode (paper, Training environments).
        slack_s: Time that every episode in scene families has [s].
        slowness: How many times as long as the way to the goal takes at full speed it has besides.
        clearance_m: Distance to the scene from which the reward term `clearance` counts speed [m].
        information_m: Distance from the base at which the reward term `information` asks whether a thing
            had been seen, and within which the gaze looks for what was not [m].
        scene: Parameters of the layout generator.
        noise: Sensor noise.
        guard: What keeps the base from driving into what was seen, whatever the policy asks for.
        planner: What gives the policy points of the way through what was seen for its goal.
        lidar: A lidar on the base, with `odometry` as observation groups, for baselines.
        odometry: Errors of the odometry that comes with it.
    """

    camera_action: Annotated[str, Choice(CAMERA_ACTIONS)] = "target"
    camera_frozen_after_s: float | None = None
    teach_gaze: bool = False
    gaze_poses: tuple[tuple[float, float], ...] = ()
    stop_on_collision: bool = True
    slack_s: float = 10.0
    slowness: float = 3.0
    clearance_m: float = 0.15
    information_m: float = 0.7
    reward: dict[str, float] = field(
        default_factory=lambda: {"progress": 2.0, "success": 10.0, "collision": -10.0, "time": -0.01}
    )
    scene: GeneratorParams = field(default_factory=GeneratorParams)
    noise: NavNoise = field(default_factory=NavNoise)
    guard: GuardConfig = field(default_factory=GuardConfig)
    planner: PlannerConfig = field(default_factory=PlannerConfig)
    lidar: LidarConfig = field(default_factory=LidarConfig)
    odometry: OdometryConfig = field(default_factory=OdometryConfig)

    def __post_init__(self) -> None:
        """Reject impossible values with the key's name."""
        super().__post_init__()
        require_positive(self, "task", ("slowness",))
        if self.teach_gaze and self.camera_action == "rate":
            raise ValueError("task.teach_gaze: needs task.camera_action=target, not rate")
        for pose in self.gaze_poses:
            check_head_pose("task.gaze_poses", pose)
        if len(set(self.gaze_poses)) < len(self.gaze_poses):
            raise ValueError("task.gaze_poses: a pose stands twice: which one comes next is not clear")
        check_scales(self.reward, TERMS)
