"""The scene geoms that follow the robot: physics of a scene of any size costs what its surroundings cost."""

from __future__ import annotations

import mujoco
import mujoco_warp as mjw
import warp as wp

from spin_rl.scenes.builder import geoms_of, near_geom_names, write_near_geoms
from spin_rl.scenes.layout import Layout
from spin_rl.warp_kernels.nearby import REACH_M, find_nearby

_COMING_M = 0.3
"""What a robot and a thing drive towards each other in a control step, and more [m]."""
_FAR_M = 1.0e6


class Nearby:
    """Keeps `layout.nearby` and the geoms that touch the robot up to date, where a scene has more slots.

    Attributes:
        missed: Updates of single worlds in which more slots were within the robot's reach than are listed,
            since it was last cleared, shape (1,), int32.
    """

    def __init__(
        self,
        layout: Layout,
        mj_model: mujoco.MjModel,
        model: mjw.Model,
        data: mjw.Data,
        *,
        robot_alone: bool,
    ) -> None:
        """Allocate the list's distances and find the geoms.

        Args:
            layout: Scenes; `nearby` is written.
            mj_model: The model with `builder.add_pool(..., nearby)`.
            model: Its batched form.
            data: The batched state.
            robot_alone: Nothing but the robot moves by physics: what is out of its reach need not be there.
        """
        self._layout = layout
        self._within = float(REACH_M) + _COMING_M if robot_alone else _FAR_M
        self._data = data
        self._geoms = geoms_of(model, data)
        with wp.ScopedDevice(layout.device):
            self._distance = wp.zeros(layout.nearby.shape, dtype=float)
            self.missed = wp.zeros(1, dtype=wp.int32)
            self._boxes, self._cylinders = (
                wp.array([mj_model.geom(name).id for name in names], dtype=wp.int32)
                for names in near_geom_names(layout.pool, layout.nearby.shape[1])
            )

    def update(self) -> None:
        """List the slots nearest to the robot, and move the geoms there; graph-safe."""
        layout = self._layout
        find_nearby(
            layout.pos,
            layout.yaw,
            layout.half_size,
            layout.active,
            layout.is_cylinder,
            self._data.qpos,
            distance_out=self._distance,
            nearby_out=layout.nearby,
            missed_out=self.missed,
        )
        self.write()

    def write(self) -> None:
        """Move the geoms to where the listed slots are now that may be touched; graph-safe."""
        write_near_geoms(
            self._layout, self._distance, self._within, self._boxes, self._cylinders, self._geoms
        )
