"""What defines the fetch task, with the defaults of the code."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from spin_rl.deploy.fetch.numbers import STAGES
from spin_rl.scenes.corridor_tables.params import FetchSceneParams
from spin_rl.sim.config import SimConfig
from spin_rl.tasks.common.config import CorridorConfig, CurriculumConfig, require_positive
from spin_rl.tasks.nav.config import NavNoise
from spin_rl.tasks.pick.config import GRASP_SIM, GraspConfig

CARRY_SIM = replace(GRASP_SIM, impratio=400.0)
"""Physics in which fingers hold an object for long, as in conf/sim/carry.yaml."""
CARRY_JOINTS = ("lift", "arm_extension", "wrist_yaw", "wrist_pitch", "wrist_roll")


@dataclass(frozen=True)
class StageLimits:
    """Longest time in each stage [s], the names of `state.STAGES`."""

    reach: float = 60.0
    align: float = 30.0
    pick: float = 12.0
    retract: float = 20.0
    carry: float = 60.0
    place: float = 25.0

    def __post_init__(self) -> None:
        """Reject limits that are none."""
        require_positive(self, "task.limits", STAGES)

    def seconds(self) -> tuple[float, ...]:
        """Return the limits in the order of the stages."""
        return tuple(getattr(self, name) for name in STAGES)


@dataclass(frozen=True)
class FetchNoise(NavNoise):
    """Sensor noise, standard deviations of zero-mean normal noise.

    Attributes:
        object_m: Of every coordinate of o_i and of o_t [m].
    """

    object_m: float = 0.0


@dataclass(frozen=True)
class FetchConfig(GraspConfig, CorridorConfig):
    """Everything that defines the fetch task.

    Attributes:
        episode_s: Longest episode [s]; the stages' limits end it before.
        pick_range_m: Depths that the pick policy sees as 0 and as 255 [m], if it was not trained with those
            of the depth filter.
        tell_table: Whether scandots tell of the table too. Without it tokens are those of navigation, slot
            for slot, as a policy needs that takes a fixed number of them.
        limits: Longest time in each stage.
        retries: Further attempts to pick as long as the object is on the table.
        home_tolerance_m: Distance at which the start is reached again [m]; unlike goals, starts can be where
            the navigation policy would not stop, close to a wall or obstacle.
        place_m: Largest distance from the robot's start to the object at the end [m].
        head_sweeps: The head sweeps to find the object; else, and where it is held, the base turns instead.
        carry_moves: Arm and wrist joints that the navigation policy moves while it carries; the others hold.
        carry_lift_m: Lowest lift while it carries [m].
        scene: Parameters of the scenes.
        noise: Sensor noise.
    """

    episode_s: float = 300.0
    pick_range_m: tuple[float, float] | None = None
    tell_table: bool = True
    limits: StageLimits = field(default_factory=StageLimits)
    retries: int = 1
    home_tolerance_m: float = 0.35
    place_m: float = 0.5
    head_sweeps: bool = True
    carry_moves: tuple[str, ...] = ("lift",)
    carry_lift_m: float = 0.5
    curriculum: CurriculumConfig = field(default_factory=lambda: CurriculumConfig(enabled=False, start=1.0))
    sim: SimConfig = CARRY_SIM
    scene: FetchSceneParams = field(default_factory=FetchSceneParams)
    noise: FetchNoise = field(default_factory=FetchNoise)

    def __post_init__(self) -> None:
        """Reject impossible values with the key's name."""
        super().__post_init__()
        if self.pick_range_m is not None:
            near, far = self.pick_range_m
            if not 0.0 <= near < far < math.inf:
                raise ValueError(f"task.pick_range_m must be two depths, the nearer first, got {near}, {far}")
            if self.depth is None:
                raise ValueError("task.pick_range_m changes nothing without depth images")
        if not self.tell_table and self.sim.nearby < self.scene.pool.num_slots:
            raise ValueError(
                f"task.tell_table=false needs all slots in their order: sim.nearby must be at least "
                f"{self.scene.pool.num_slots}, got {self.sim.nearby}"
            )
        if self.retries < 0:
            raise ValueError(f"task.retries must not be negative, got {self.retries}")
        unknown = sorted(set(self.carry_moves) - set(CARRY_JOINTS))
        if unknown:
            raise ValueError(f"task.carry_moves: {unknown[0]!r} is not one of {', '.join(CARRY_JOINTS)}")
        if not 0.45 <= self.carry_lift_m <= 1.0:
            raise ValueError(f"task.carry_lift_m must be in [0.45, 1.0], got {self.carry_lift_m}")
        if self.reward:
            raise ValueError(f"reward.{min(self.reward)}: a fetch has no reward")
