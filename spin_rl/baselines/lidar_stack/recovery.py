"""What robots do where they get no nearer to the goal, as move_base: forget, turn round, back up, in turn."""

from __future__ import annotations

import numpy as np

from spin_rl.baselines.lidar_stack.settings import RecoverySettings

DRIVING, CLEARING, ROTATING, BACKING = range(4)
"""What a robot does; driving on while it waits for what it has forgotten to be seen anew is clearing."""

_DETOUR_M = 0.5
"""By so much a new plan's way is longer where what was the way is blocked."""


class Recovery:
    """Watches the ways left in all worlds.

    Attributes:
        mode: What every robot does, shape (n,), int.
        side: Which way it turns, 1 or -1, shape (n,).
    """

    def __init__(self, nworld: int, cfg: RecoverySettings, period: float, rng: np.random.Generator) -> None:
        """Allocate for a number of worlds and a control period [s]."""
        seconds = np.array([cfg.patience_s, cfg.clear_s, cfg.rotate_s, cfg.back_s])
        self._steps = np.maximum(np.round(seconds / period).astype(int), 1)
        self._cfg, self._rng = cfg, rng
        self.mode = np.zeros(nworld, dtype=int)
        self.side = np.ones(nworld)
        self._least = np.full(nworld, np.inf)
        self._last = np.full(nworld, np.inf)
        self._waited = np.zeros(nworld, dtype=int)
        self._next = np.full(nworld, CLEARING)

    def restart(self, worlds: np.ndarray) -> None:
        """Begin anew in some worlds, a mask."""
        self.mode[worlds] = DRIVING
        self._least[worlds] = self._last[worlds] = np.inf
        self._waited[worlds] = 0
        self._next[worlds] = CLEARING

    def watch(self, way: np.ndarray, replanned: np.ndarray) -> np.ndarray:
        """Change what robots do.

        Args:
            way: Ways left [m], shape (n,).
            replanned: Where they are those of a new plan, a mask, shape (n,): a detour is longer.

        Returns:
            Worlds in which what was seen of late is to be forgotten, a mask.
        """
        longer = way - self._last
        self._least += np.where(replanned & (longer > _DETOUR_M), longer, 0.0)
        self._last = way.copy()
        nearer = way < self._least - self._cfg.progress_m
        self._least = np.where(nearer, way, self._least)
        self._waited = np.where(nearer & (self.mode <= CLEARING), 0, self._waited + 1)
        self._next[nearer] = CLEARING
        self.mode[nearer & (self.mode == CLEARING)] = DRIVING
        over = self._waited >= self._steps[self.mode]
        ends = over & (self.mode != DRIVING)
        begins = over & (self.mode == DRIVING)
        self.mode[ends] = DRIVING
        # After the first the others follow at once, as long as nothing helps.
        begins |= ends & (self._next != CLEARING)
        self.mode[begins] = self._next[begins]
        self._waited[over] = 0
        cleared = begins & (self.mode == CLEARING)
        self._next[begins] = np.where(self.mode[begins] == BACKING, CLEARING, self.mode[begins] + 1)
        turning = begins & (self.mode == ROTATING)
        self.side[turning] = np.where(self._rng.random(int(turning.sum())) < 0.5, -1.0, 1.0)
        self._least[ends] = way[ends]
        return cleared
