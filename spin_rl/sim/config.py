"""Options of the batched physics."""

from __future__ import annotations

from dataclasses import dataclass

OVERFLOW_MODES = ("count", "raise")
# More takes longer than anyone waits, or more memory than there is.
_MOST = {
    "substeps": 100,
    "iterations": 1000,
    "ls_iterations": 1000,
    "nearby": 1000,
    "contacts_per_world": 10_000,
    "constraints_per_world": 10_000,
}


@dataclass(frozen=True)
class SimConfig:
    """Options of the batched physics.

    Attributes:
        timestep: Physics step [s].
        substeps: Physics steps per control step; the control period is their product.
        kinematic: Leave forces out: servos do what they are told, and what touches does not push. For
            navigation in training, where contact ends the episode.
        iterations: Constraint solver iterations.
        ls_iterations: Line-search iterations.
        impratio: How much harder friction is than normal contact; None takes the robot's, 10 for the one
            that grasps. What is held creeps out of the fingers, the slower the larger this is.
        nearby: Scene geoms that physics and scandots know at a time: those nearest to the robot where a scene
            has more of them.
        contacts_per_world: Contacts allocated per world, on average over the worlds.
        constraints_per_world: Constraint rows allocated for each world.
        overflow: What to do about dropped contacts and constraints: "count" them in the statistics, or
            "raise" an error when the statistics are read.
    """

    timestep: float = 0.02
    substeps: int = 5
    kinematic: bool = False
    iterations: int = 4
    ls_iterations: int = 8
    impratio: float | None = None
    nearby: int = 64
    contacts_per_world: int = 24
    constraints_per_world: int = 96
    overflow: str = "count"

    def __post_init__(self) -> None:
        """Reject values that physics cannot run with."""
        if not 0.0 < self.timestep <= 0.05:
            raise ValueError(f"sim.timestep must be in (0, 0.05] s, got {self.timestep}")
        for name, most in _MOST.items():
            value = getattr(self, name)
            if value < 1:
                raise ValueError(f"sim.{name} must be at least 1, got {value}")
            if value > most:
                raise ValueError(f"sim.{name} must be at most {most}, got {value}")
        if self.impratio is not None and not 1.0 <= self.impratio <= 1000.0:
            raise ValueError(f"sim.impratio must be in [1, 1000], got {self.impratio}")
        if self.overflow not in OVERFLOW_MODES:
            raise ValueError(f"sim.overflow must be {' or '.join(OVERFLOW_MODES)}, got {self.overflow!r}")

    @property
    def control_period(self) -> float:
        """Time between two actions [s]."""
        return self.timestep * self.substeps
