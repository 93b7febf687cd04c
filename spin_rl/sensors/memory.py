# pyright: reportGeneralTypeIssues=false
# (to a type checker, a Warp struct is an object, not a class)
"""What the robot remembers of the things that its camera saw."""

from __future__ import annotations

import warp as wp

from spin_rl.sensors.interface import Sensor
from spin_rl.sensors.scandots import Scandots
from spin_rl.warp_kernels import memory
from spin_rl.warp_kernels.slots import SlotArrays, slots_of


class SeenThings(Sensor):
    """Remembers what scandots tell; see ``spin_rl.warp_kernels.memory``.

    Attributes:
        memory: What was seen, a struct of arrays of shape (nworld, nslot).
        obstacles: The slots that it was seen of, a struct.
    """

    def __init__(
        self,
        obstacles: SlotArrays,
        nearby: wp.array,
        qpos: wp.array,
        scandots: Scandots,
        step: wp.array,
        max_age: int,
    ) -> None:
        """Allocate the memory.

        Args:
            obstacles: Obstacle slots, shape (nworld, nslot).
            nearby: Slots of the tokens, shape (nworld, k), int32.
            qpos: ``d.qpos``, shape (nworld, nq).
            scandots: The scandot sensor; updated before this one is.
            step: Control steps of the running episodes, shape (nworld,), int32.
            max_age: Steps after which what was not seen again is forgotten.
        """
        self.obstacles = slots_of(obstacles)
        self._nearby = nearby
        self._qpos = qpos
        self._visible = scandots.visible
        shape = obstacles.pos.shape
        self.memory = memory.Memory()
        with wp.ScopedDevice(obstacles.pos.device):
            for name in ("low", "high", "pose"):
                setattr(self.memory, name, wp.zeros(shape, dtype=wp.vec3))
            self.memory.velocity = wp.zeros(shape, dtype=wp.vec2)
            self.memory.seen_at = wp.full(shape, -1, dtype=wp.int32)
            self.memory.changed = wp.zeros(shape[0], dtype=bool)
        self.memory.step = step
        self.memory.max_age = max_age

    def begin(self, mask: wp.array) -> None:
        """Forget the last episode in the masked worlds, shape (nworld,), bool."""
        memory.forget(self.memory, mask)

    def update(self) -> None:
        """Take in what is seen now; graph-safe, and call it after the scandots'."""
        memory.remember(self.obstacles, self._nearby, self._qpos, self._visible, self.memory)
