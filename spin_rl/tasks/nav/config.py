"""What defines the navigation task, with the defaults of the code."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from spin_rl.scenes.corridors.params import GeneratorParams
from spin_rl.tasks.common.config import ScandotsConfig, TaskConfig
from spin_rl.tasks.common.rewards import check_scales
from spin_rl.tasks.nav.observations import NavNoise
from spin_rl.tasks.nav.rewards import TERMS


@dataclass(frozen=True)
class NavConfig(TaskConfig):
    """Everything that defines the navigation task.

    Attributes:
        goal_tolerance_m: Distance at which the goal is reached [m] (paper, Real-world results: 15 cm).
        stop_on_collision: Whether touching the scene ends the episode (paper, Training environments).
        scenario: 1 straight, 2 L-shaped, 0 a mix of both.
        difficulty: 0 easy, 1 medium, 2 hard, -1 a mix limited by the curriculum.
        clearance_m: Distance to the scene from which the reward term `clearance` counts speed [m].
        scene: Parameters of the layout generator.
        scandots: Visibility options.
        noise: Sensor noise.
    """

    goal_tolerance_m: float = 0.15
    stop_on_collision: bool = True
    scenario: int = 0
    difficulty: int = -1
    clearance_m: float = 0.15
    reward: dict[str, float] = field(
        default_factory=lambda: {"progress": 2.0, "success": 10.0, "collision": -10.0, "time": -0.01}
    )
    scene: GeneratorParams = field(default_factory=GeneratorParams)
    scandots: ScandotsConfig = field(default_factory=ScandotsConfig)
    noise: NavNoise = field(default_factory=NavNoise)

    def __post_init__(self) -> None:
        """Reject impossible values with the key's name."""
        super().__post_init__()
        if not 0.0 < self.goal_tolerance_m < math.inf:
            raise ValueError(f"task.goal_tolerance_m must be positive, got {self.goal_tolerance_m}")
        if not 0.0 < self.clearance_m < math.inf:
            raise ValueError(f"task.clearance_m must be positive, got {self.clearance_m}")
        if self.scenario not in (0, 1, 2):
            raise ValueError(f"task.scenario must be 0, 1 or 2, got {self.scenario}")
        if self.difficulty not in (-1, 0, 1, 2):
            raise ValueError(f"task.difficulty must be -1, 0, 1 or 2, got {self.difficulty}")
        check_scales(self.reward, TERMS)
