"""Things that move around the robot in C MuJoCo: the law of `scenes.motion` for one world, in NumPy."""

from __future__ import annotations

import numpy as np

from spin_rl.scenes.layout import Scene


class Movers:
    """Where the moving slots of a scene are.

    Attributes:
        slots: Their indices, shape (n,).
        pos: Their centres [m], shape (n, 3).
    """

    def __init__(self, scene: Scene) -> None:
        """Put them where they start."""
        self.slots = np.flatnonzero(scene.active & (scene.motion_speed > 0.0))
        self._home, self._retreat = scene.home[self.slots], scene.retreat[self.slots]
        self._speed, self._trigger = scene.motion_speed[self.slots], scene.motion_trigger[self.slots]
        self._phase = scene.motion_phase[self.slots]
        self._moved = np.zeros(len(self.slots))
        self.pos = self._places()

    def advance(self, base: np.ndarray, dt: float) -> None:
        """Move by one time step.

        Args:
            base: Where the robot's base is [m], shape (2,).
            dt: Time step [s].
        """
        away = np.linalg.norm(base - self._home[:, :2], axis=-1)
        waits = (self._trigger > 0.0) & (self._moved == 0.0) & ~(away < self._trigger)
        self._moved += np.where(waits, 0.0, self._speed * dt)
        self.pos = self._places()

    def _places(self) -> np.ndarray:
        gone = self._moved / np.maximum(np.linalg.norm(self._retreat, axis=-1), 1e-6)
        turn = self._phase + 0.5 * gone  # out and back is one period of 2 retreats
        to_and_fro = np.abs(2.0 * (turn - np.floor(turn)) - 1.0)
        share = np.where(self._trigger == 0.0, to_and_fro, np.maximum(1.0 - gone, 0.0))
        return self._home + share[:, None] * np.pad(self._retreat, ((0, 0), (0, 1)))
