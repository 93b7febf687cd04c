"""Where a fetch is: the counterpart of `spin_rl.tasks.fetch.state.FetchState`, whose names it has."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from spin_rl.deploy.fetch.numbers import REACH


@dataclass
class Memory:
    """What scripts and stages remember.

    Attributes:
        home: Where the robot started [m], shape (2,).
        goal: Where the navigation policy drives [m], shape (2,).
        others: As in `FetchState`.
    """

    home: np.ndarray
    goal: np.ndarray
    stage: int = REACH
    time: int = 0
    length: int = 0
    phase: int = 0
    phase_time: int = 0
    ready: bool = False
    held: int = 0
    loose: int = 0
    stuck: int = 0
    detour: bool = False
    retries: int = 0
    stand: np.ndarray = field(default_factory=lambda: np.zeros(3))
    found: np.ndarray = field(default_factory=lambda: np.zeros(3))
    is_found: bool = False
    rest: float = 0.0
    grip: tuple[float, float] = (0.0, 0.0)
    mark: float = 0.0
