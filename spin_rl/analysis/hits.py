"""What the robot ran into, and whether its camera had ever shown it."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import mujoco
import numpy as np

from spin_rl import robot
from spin_rl.sim.model import geom_parts
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


@dataclass(frozen=True)
class Touch:
    """A part of the robot and what it is about to touch.

    Attributes:
        part: One of `robot.PARTS`.
        slot: The nearest active slot, or `FLOOR`.
        distance: Between them [m], negative in penetration.
        point_b: Nearest point of the part in the base frame [m], shape (3,).
    """

    part: str
    slot: int
    distance: float
    point_b: np.ndarray


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
    parts at the last observation before it. Slots may move, so their positions are given for that time.
    """

    def __init__(self, sim: Simulation) -> None:
        """Copy the model of a simulation."""
        self._layout = sim.layout
        self._model = copy.copy(sim.mj_model)
        self._data = mujoco.MjData(self._model)
        self._slot_geoms = [self._model.geom(name).id for name in sim.layout.pool.geom_names()]
        self._floor = self._model.geom("floor").id
        parts = np.array(geom_parts(self._model))
        self._part_geoms = [np.flatnonzero(parts == part).tolist() for part in range(len(robot.PARTS))]

    def remember_layouts(self) -> None:
        """Copy the current layouts of all worlds."""
        layout = self._layout
        self._yaw, self._half_size, self._active = (
            array.numpy().copy() for array in (layout.yaw, layout.half_size, layout.active)
        )

    def find(self, world: int, pos: np.ndarray, qpos: np.ndarray, parts: np.ndarray) -> list[Touch]:
        """Return what of a remembered layout is nearest to each of some robot parts.

        Args:
            world: Index of the world.
            pos: Positions of its slots [m], shape (nslot, 3).
            qpos: State of the robot, shape (13,).
            parts: Which of `robot.PARTS` to look at, at least one, shape (6,), bool.

        Returns:
            One per part, the nearest first.
        """
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        slots = [FLOOR, *np.flatnonzero(self._active[world]).tolist()]
        for slot in slots[1:]:
            self._place(slot, world, pos[slot])
        nearest = [
            min(
                (self._measure(part, geom, slot) for slot in slots for geom in self._part_geoms[part]),
                key=lambda touch: touch.distance,
            )
            for part in np.flatnonzero(parts).tolist()
        ]
        return sorted(nearest, key=lambda touch: touch.distance)

    def _place(self, slot: int, world: int, pos: np.ndarray) -> None:
        geom, half = self._slot_geoms[slot], self._half_size[world, slot]
        is_cylinder = slot >= self._layout.pool.first_cylinder
        self._model.geom_size[geom] = (half[0], half[2], 0.0) if is_cylinder else half
        self._data.geom_xpos[geom] = pos
        c, s = np.cos(self._yaw[world, slot]), np.sin(self._yaw[world, slot])
        self._data.geom_xmat[geom] = (c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)

    def _measure(self, part: int, robot_geom: int, slot: int) -> Touch:
        if slot == FLOOR and not self._model.geom_conaffinity[robot_geom] & _FLOOR_BIT:
            return Touch(robot.PARTS[part], FLOOR, _FAR_M, np.zeros(3))
        geom = self._floor if slot == FLOOR else self._slot_geoms[slot]
        points = np.zeros(6)
        distance = mujoco.mj_geomDistance(self._model, self._data, robot_geom, geom, _FAR_M, points)
        base = self._data.body("base")
        point_b = base.xmat.reshape(3, 3).T @ (points[:3] - base.xpos)
        return Touch(robot.PARTS[part], slot, distance, point_b)
