"""What a task asks of a sensor."""

from __future__ import annotations

import warp as wp


class Sensor:
    """Preallocated buffers that kernels refresh from simulator memory; both methods are graph-safe."""

    def begin(self, mask: wp.array) -> None:
        """Forget the last episode in the masked worlds, shape (nworld,), bool; most remember nothing.

        Called before the poses of the new episodes are computed.
        """

    def update(self) -> None:
        """Measure in all worlds, once in a control step, from the poses that the simulation has computed."""
        raise NotImplementedError
