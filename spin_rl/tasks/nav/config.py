"""What defines the navigation task, with the defaults of the code."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from spin_rl.config import Choice, Range
from spin_rl.scenes.corridors.params import GeneratorParams
from spin_rl.sensors.lidar import LidarConfig
from spin_rl.sensors.noisy_map import MapConfig
from spin_rl.sensors.odometry import OdometryConfig
from spin_rl.tasks.common.config import CorridorConfig, ProprioNoise, require_positive
from spin_rl.tasks.common.rewards import check_scales
from spin_rl.tasks.nav.rewards import TERMS


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
        memory_s: Time after which what was not seen again is forgotten [s].
    """

    enabled: bool = False
    look_ahead_s: Annotated[float, Range(0.0, 2.0, above=True)] = 0.5
    margin_m: Annotated[float, Range(0.0, 0.5)] = 0.01
    lag_s: float = 0.2
    memory_s: float = 10.0

    def __post_init__(self) -> None:
        """Reject times that are none."""
        require_positive(self, "task.guard", ("lag_s", "memory_s"))


CAMERA_ACTIONS = ("target", "rate")


@dataclass(frozen=True)
class NavConfig(CorridorConfig):
    """Everything that defines the navigation task.

    Attributes:
        camera_action: What the camera's two actions say: "target", where the head goes, or "rate", how fast
            its target moves, 1 being the head's largest speed.
        camera_frozen_after_s: Time in an episode from which on the head stays where it was sent by then
            [s]; None lets it move. `camera_pose` goes before both.
        teach_gaze: Whether there is a group that says where to look, `gaze`, for a policy to imitate. Not
            with camera actions that are rates.
        stop_on_collision: Whether touching the scene ends the episode (paper, Training environments).
        slack_s: Time that every episode in scene families has [s].
        slowness: How many times as long as the way to the goal takes at full speed it has besides.
        clearance_m: Distance to the scene from which the reward term `clearance` counts speed [m].
        information_m: Distance from the base at which the reward term `information` asks whether a thing
            had been seen [m].
        scene: Parameters of the layout generator.
        noise: Sensor noise.
        map: A noisy map as an observation group (paper, baseline Mapping).
        guard: What keeps the base from driving into what was seen, whatever the policy asks for.
        lidar: A lidar on the base, with `odometry` as observation groups, for baselines.
        odometry: Errors of the odometry that comes with it.
    """

    camera_action: Annotated[str, Choice(CAMERA_ACTIONS)] = "target"
    camera_frozen_after_s: float | None = None
    teach_gaze: bool = False
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
    map: MapConfig = field(default_factory=MapConfig)
    guard: GuardConfig = field(default_factory=GuardConfig)
    lidar: LidarConfig = field(default_factory=LidarConfig)
    odometry: OdometryConfig = field(default_factory=OdometryConfig)

    def __post_init__(self) -> None:
        """Reject impossible values with the key's name."""
        super().__post_init__()
        require_positive(self, "task", ("slowness",))
        if self.teach_gaze and self.camera_action != "target":
            raise ValueError(f"task.teach_gaze: needs camera_action=target, not {self.camera_action}")
        check_scales(self.reward, TERMS)
