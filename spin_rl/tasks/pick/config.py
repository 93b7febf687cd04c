"""What defines the pick task, with the defaults of the code."""

from __future__ import annotations

from dataclasses import dataclass, field

from spin_rl.scenes.tabletops.params import TabletopParams
from spin_rl.sim.config import SimConfig
from spin_rl.sim.targets import ManipulationConfig
from spin_rl.tasks.common import rewards
from spin_rl.tasks.common.config import CurriculumConfig, DynamicsConfig, ProprioNoise, TaskConfig
from spin_rl.tasks.common.objects.config import ANY_OBJECT, SightConfig, check_detector, check_object
from spin_rl.tasks.pick import rewards as pick_rewards

GRASP_SIM = SimConfig(
    timestep=0.0125,
    substeps=8,
    iterations=10,
    ls_iterations=30,
    contacts_per_world=32,
    constraints_per_world=160,
)
"""Physics in which fingers hold an object, as in conf/sim/grasp.yaml."""


@dataclass(frozen=True)
class PickNoise(ProprioNoise):
    """Sensor noise in training, standard deviations of zero-mean normal noise.

    Attributes:
        object_m: Of every coordinate of o_i and of o_t, drawn in every step [m].
        object_start_m: Of every coordinate of o_i, drawn once an episode: what a detector errs at the start
            stays [m].
    """

    object_m: float = 0.0
    object_start_m: float = 0.0


@dataclass(frozen=True)
class GraspConfig(TaskConfig):
    """What tasks with an object to grasp have.

    Attributes:
        lift_m: Height over its start at which the object counts as lifted [m].
        hold_s: Time for which it must be held there to be picked [s].
        grasp_force_n: Sum of both fingertips' forces from which the object is grasped [N] (paper, r_lift).
        finger_force_n: Smallest force of each of them [N].
        hard_force_n: Force on the scene of a part other than the fingers that ends the episode, while the
            robot is not driving [N].
        fall_m: Depth of the object's centre below the table's top at which it is lost [m].
        object: One of `objects.OBJECTS`, "any", or several joined by +, for the worlds in turn.
        detector: How the object is found, one of `sight.DETECTORS`: "none" takes its true place while
            it is in sight (`sight`), "segmentation" finds it in depth images.
        sight: When the camera sees the object.
        manipulation: How actions move the joints.
    """

    lift_m: float = 0.1
    hold_s: float = 1.0
    grasp_force_n: float = 10.0
    finger_force_n: float = 1.0
    hard_force_n: float = 30.0
    fall_m: float = 0.05
    object: str = ANY_OBJECT
    detector: str = "none"
    dynamics: DynamicsConfig = field(
        default_factory=lambda: DynamicsConfig((0.15, 0.15), (0.1, 0.1), (1.0, 1.0))
    )
    sim: SimConfig = GRASP_SIM
    sight: SightConfig = field(default_factory=SightConfig)
    manipulation: ManipulationConfig = field(default_factory=ManipulationConfig)

    def __post_init__(self) -> None:
        """Reject impossible values with the key's name."""
        super().__post_init__()
        check_object(self.object)
        check_detector(self.detector)


@dataclass(frozen=True)
class PickConfig(GraspConfig):
    """Everything that defines the pick task.

    Attributes:
        end_on_success: Whether a success ends the episode, or the object is to be held up until the time
            limit.
        near_share: Share of episodes that start with the gripper near the object, at the curriculum's start
            and at level 1.
        scene: Parameters of the tabletop generator.
        noise: Sensor noise.
    """

    episode_s: float = 7.0
    end_on_success: bool = False
    near_share: tuple[float, float] = (0.5, 0.1)
    reward: dict[str, float] = field(
        default_factory=lambda: {"reach": 0.1, "grasp": 0.1, "lift": 0.3, "success": 0.3}
    )
    curriculum: CurriculumConfig = field(default_factory=lambda: CurriculumConfig(up=0.1, down=0.15))
    scene: TabletopParams = field(default_factory=TabletopParams)
    noise: PickNoise = field(default_factory=PickNoise)

    def __post_init__(self) -> None:
        """Reject impossible values with the key's name."""
        super().__post_init__()
        for share in self.near_share:
            if not 0.0 <= share <= 1.0:
                raise ValueError(f"task.near_share must be in [0, 1], got {share}")
        rewards.check_scales(self.reward, pick_rewards.TERMS)
