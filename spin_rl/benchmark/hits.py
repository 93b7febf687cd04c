"""What the robot ran into, and whether its camera had ever shown it."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import mujoco
import numpy as np

from spin_rl import robot
from spin_rl.sim.simulation import Simulation

FLOOR = -1
"""Stands for the floor where a slot is expected."""
_FLOOR_BIT = 2  # of geom_conaffinity: arm, wrist and gripper touch the floor
_FAR_M = 10.0


@dataclass(frozen=True)
class Hit:
    """A collision that ended an episode.

    Attributes:
        kind: `obstacle`, `wall` or `floor`.
        seen: Whether the camera had shown any corner of it in this episode.
    """

    kind: str
    seen: bool


def summarize_hits(hits: list[Hit]) -> dict[str, float | int | None]:
    """Count hits.

    Returns:
        `obstacle_hits`, `wall_hits`, `floor_hits`, `never_seen` (obstacles hit of which no corner was ever
        visible) and `never_seen_share` of the obstacle hits, None without any.
    """
    counts = {f"{kind}_hits": sum(hit.kind == kind for hit in hits) for kind in ("obstacle", "wall", "floor")}
    never_seen = sum(hit.kind == "obstacle" and not hit.seen for hit in hits)
    total = counts["obstacle_hits"]
    return counts | {"never_seen": never_seen, "never_seen_share": never_seen / total if total else None}


class NearestObstacle:
    """Finds what a robot part is about to touch, with exact distances of MuJoCo on the host.

    When a step ends an episode, the step has cleared that world's contacts and drawn its next layout. So
    layouts are copied at the start of episodes, and a hit goes to the slot that was nearest to the touching
    parts at the last observation before it.
    """

    def __init__(self, sim: Simulation) -> None:
        """Copy the model of a simulation."""
        self._layout = sim.layout
        self._model = copy.copy(sim.mj_model)
        self._data = mujoco.MjData(self._model)
        self._slot_geoms = [self._model.geom(name).id for name in sim.layout.pool.geom_names()]
        self._floor = self._model.geom("floor").id
        self._part_geoms = [
            [
                geom
                for geom in range(self._model.ngeom)
                if self._model.geom_bodyid[geom] > 0
                and self._model.geom_conaffinity[geom]
                and self._model.geom(geom).name.rstrip("0123456789").rstrip("_") == part
            ]
            for part in robot.PARTS
        ]

    def remember_layouts(self) -> None:
        """Copy the current layouts of all worlds."""
        layout = self._layout
        self._pos, self._yaw, self._half_size, self._active = (
            array.numpy().copy() for array in (layout.pos, layout.yaw, layout.half_size, layout.active)
        )

    def find(self, world: int, qpos: np.ndarray, parts: np.ndarray) -> int:
        """Return the active slot of a remembered layout that is nearest to some robot parts, or FLOOR.

        Args:
            world: Index of the world.
            qpos: State of the robot, shape (13,).
            parts: Which of `robot.PARTS` to look at, at least one, shape (6,), bool.
        """
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        candidates = {FLOOR: self._floor}
        for slot in np.flatnonzero(self._active[world]):
            candidates[int(slot)] = self._slot_geoms[slot]
            self._place(int(slot), world)
        geoms = [geom for part in np.flatnonzero(parts) for geom in self._part_geoms[part]]
        return min(candidates, key=lambda slot: min(self._distance(geom, candidates[slot]) for geom in geoms))

    def _place(self, slot: int, world: int) -> None:
        geom, half = self._slot_geoms[slot], self._half_size[world, slot]
        is_cylinder = slot >= self._layout.pool.first_cylinder
        self._model.geom_size[geom] = (half[0], half[2], 0.0) if is_cylinder else half
        self._data.geom_xpos[geom] = self._pos[world, slot]
        c, s = np.cos(self._yaw[world, slot]), np.sin(self._yaw[world, slot])
        self._data.geom_xmat[geom] = (c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)

    def _distance(self, robot_geom: int, scene_geom: int) -> float:
        if scene_geom == self._floor and not self._model.geom_conaffinity[robot_geom] & _FLOOR_BIT:
            return _FAR_M
        return mujoco.mj_geomDistance(self._model, self._data, robot_geom, scene_geom, _FAR_M, None)
