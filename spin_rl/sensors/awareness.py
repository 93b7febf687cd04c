"""Whether what comes near the robot had been seen before, for the reward term `information`."""

from __future__ import annotations

import warp as wp

from spin_rl.sensors.interface import Sensor
from spin_rl.sensors.memory import SeenThings
from spin_rl.sensors.scandots import Obstacles
from spin_rl.warp_kernels.awareness import FRESH_S, forget, notice
from spin_rl.warp_kernels.slots import slots_of


class Awareness(Sensor):
    """Notices every thing once an episode, when it comes near; see ``spin_rl.warp_kernels.awareness``.

    Attributes:
        gain: Things that came near in the last step and were known, less those that were not, shape
            (nworld,).
    """

    def __init__(
        self, obstacles: Obstacles, qpos: wp.array, seen: SeenThings, near_m: float, period: float
    ) -> None:
        """Allocate the buffers.

        Args:
            obstacles: Obstacle slots, shape (nworld, nslot).
            qpos: ``d.qpos``, shape (nworld, nq).
            seen: What the camera has shown; updated with the observations, so up to the one before the step.
            near_m: Distance of the base that is near [m].
            period: Time between two steps [s].
        """
        self._slots, self._is_wall = slots_of(obstacles), obstacles.is_wall
        self._qpos, self._memory = qpos, seen.memory
        self._near, self._fresh = near_m, round(FRESH_S / period)
        device = obstacles.pos.device
        self._noticed = wp.zeros(obstacles.pos.shape, dtype=bool, device=device)
        self.gain = wp.zeros(obstacles.pos.shape[0], dtype=float, device=device)

    def begin(self, mask: wp.array) -> None:
        """Begin anew in the masked worlds, shape (nworld,), bool; `gain` stays that of the last step."""
        forget(mask, self._noticed)

    def update(self) -> None:
        """Notice what is near now; graph-safe."""
        notice(
            self._slots,
            self._is_wall,
            self._qpos,
            self._memory,
            near=self._near,
            fresh=self._fresh,
            noticed=self._noticed,
            gain_out=self.gain,
        )
