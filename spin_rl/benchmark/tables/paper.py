"""Figures of the SPIN paper (Uppal et al., CVPR 2024): Table 1, and throughput."""

from __future__ import annotations

from dataclasses import dataclass

from spin_rl.scenes.kinds import DIFFICULTIES, SCENARIOS


@dataclass(frozen=True)
class PaperCell:
    """One cell of Table 1: 10 environments, 3 seeds.

    Attributes:
        success_rate: Share of successful episodes.
        duration_s: "Average Episode Duration" [s]; the paper does not say whether failures count.
    """

    success_rate: float
    duration_s: float


def _row(success: tuple[float, ...], duration: tuple[float, ...]) -> dict[tuple[int, str], PaperCell]:
    cells = [(scenario, difficulty) for scenario in SCENARIOS for difficulty in DIFFICULTIES]
    return {cell: PaperCell(s, t) for cell, s, t in zip(cells, success, duration, strict=True)}


REACH: dict[str, dict[tuple[int, str], PaperCell]] = {
    "FixCam": _row((1.00, 0.53, 0.20, 1.00, 0.50, 0.26), (6.86, 23.48, 38.94, 6.54, 27.24, 42.36)),
    "NoPointNet": _row((1.00, 0.87, 0.57, 1.00, 0.77, 0.63), (6.30, 14.87, 33.25, 7.22, 15.04, 34.09)),
    "Mapping": _row((1.00, 1.00, 1.00, 0.86, 1.00, 0.97), (6.20, 14.02, 26.24, 6.55, 12.28, 28.05)),
    "SPIN (DVO)": _row((1.00, 1.00, 0.96, 1.00, 1.00, 0.90), (5.92, 16.25, 28.44, 7.32, 17.12, 32.04)),
    "SPIN (CVO)": _row((1.00, 0.97, 0.93, 1.00, 1.00, 0.93), (6.24, 14.00, 23.57, 6.55, 15.81, 29.31)),
}
"""Method -> (scenario, difficulty) -> figures."""

PICK: dict[str, PaperCell] = {
    "FixCam": PaperCell(0.86, 11.00),
    "NoPointNet": PaperCell(0.93, 9.25),
    "Mapping": PaperCell(0.97, 4.98),
    "SPIN (DVO)": PaperCell(0.97, 9.24),
    "SPIN (CVO)": PaperCell(0.97, 5.74),
}
"""Method -> figures of its pick column."""

PLACE: dict[str, dict[tuple[int, str], PaperCell]] = {
    "FixCam": _row((1.00, 0.53, 0.16, 0.97, 0.50, 0.20), (7.25, 17.06, 41.07, 8.02, 20.24, 45.98)),
    "NoPointNet": _row((1.00, 0.83, 0.57, 1.00, 0.77, 0.60), (4.88, 15.22, 32.00, 7.89, 18.49, 37.42)),
    "Mapping": _row((1.00, 1.00, 1.00, 1.00, 0.90, 0.97), (6.77, 9.85, 22.29, 4.86, 12.62, 26.12)),
    "SPIN (DVO)": _row((1.00, 1.00, 0.90, 1.00, 0.90, 0.90), (7.22, 18.45, 34.24, 9.40, 15.98, 41.24)),
    "SPIN (CVO)": _row((1.00, 0.97, 0.90, 1.00, 0.97, 0.93), (6.51, 13.39, 27.25, 8.03, 12.79, 31.25)),
}
"""Method -> (scenario, difficulty) -> figures; the object is brought back near the robot's start."""

FRAMES_PER_S = {"scandots": 50_000.0, "depth": 820.0}
"""Simulated frames per second on one GPU, 8192 worlds with scandots, 256 with depth (supplement, "Directly
training from depth images")."""

FIXCAM: dict[str, tuple[float, ...]] = {
    "I": (0.93, 0.40, 0.20, 0.97, 0.40, 0.20),
    "II": (0.70, 0.30, 0.10, 0.67, 0.47, 0.10),
    "III": (0.86, 0.33, 0.10, 0.77, 0.30, 0.10),
    "IV": (1.00, 0.53, 0.20, 1.00, 0.50, 0.26),
}
"""Pose of the camera -> success in the cells of Table 1's reach (supplement, table of the FixCam poses)."""


@dataclass(frozen=True)
class PaperRange:
    """A row of the table of visibility ranges: 10 episodes, 3 seeds.

    Attributes:
        success_rate: Share of successful episodes.
        final_distance_m: Mean distance to the goal at the end [m].
    """

    success_rate: float
    final_distance_m: float


VISIBILITY: dict[int, PaperRange] = {
    1: PaperRange(0.96, 0.28),
    2: PaperRange(0.96, 0.26),
    3: PaperRange(0.93, 0.63),
    5: PaperRange(0.86, 1.21),
}
"""Visibility range [m] -> figures (supplement, table of local visibility)."""


@dataclass(frozen=True)
class PaperPlace:
    """A cell of the real robot's table.

    Attributes:
        success_rate: Share of the runs that ended within 15 cm of the goal.
        collisions: Mean number of collisions of a run.
    """

    success_rate: float
    collisions: float


STATIC_DYNAMIC: dict[tuple[str, str], dict[str, PaperPlace]] = {
    ("lab", "static"): {"SPIN": PaperPlace(0.8, 1.0), "Classical": PaperPlace(0.6, 0.4)},
    ("lab", "dynamic"): {"SPIN": PaperPlace(0.6, 1.6), "Classical": PaperPlace(0.0, 1.2)},
    ("study", "static"): {"SPIN": PaperPlace(0.8, 0.8), "Classical": PaperPlace(0.4, 0.6)},
    ("study", "dynamic"): {"SPIN": PaperPlace(0.6, 1.6), "Classical": PaperPlace(0.2, 1.0)},
}
"""Real scene (the paper's 1 and 2, by the name of its counterpart in conf/scenes_examples) and obstacles ->
method -> figures (Real-world results, table of static and dynamic obstacles)."""

DIRECT_DEPTH_SUCCESS = 0.01
"""Less than that after 22 h of reinforcement learning from depth images (supplement, "Directly training from
depth images"); both phases of SPIN took 16 h."""
