"""An object to grasp, for the robot in C MuJoCo: what a simulator knows of hand, object and surroundings."""

from __future__ import annotations

import math
from collections.abc import Mapping

import mujoco
import numpy as np

from spin_rl import robot
from spin_rl.config import ConfigError
from spin_rl.deploy.contract import Contract
from spin_rl.deploy.fetch.known import Grip, Known, Slots, tell
from spin_rl.deploy.observations import in_base, seen_object
from spin_rl.scenes.builder import SCENE_GROUP
from spin_rl.scenes.layout import Scene
from spin_rl.scenes.objects.shapes import KINDS, OBJECT_BODY, SceneObject
from spin_rl.sim.manipulation import geom_roles
from spin_rl.warp_kernels import grasp

IMPRATIO = 400.0
"""Of contacts, as in conf/sim/carry.yaml: what hangs in the hand does not creep out of it."""
PAD_FRICTION = 1.2
_GROUP = "object"
SIGHT_M = (0.1, 4.0)
"""Depths at which the object is seen, as `task.sight` has them."""
_LEFT, _RIGHT, _TABLE, _HARD, _SUPPORT = range(5)
_NUM_SUMS = 5
_SUMS = {
    frozenset((grasp.LEFT_PAD, grasp.OBJECT)): _LEFT,
    frozenset((grasp.RIGHT_PAD, grasp.OBJECT)): _RIGHT,
    frozenset((grasp.SCENE, grasp.OBJECT)): _SUPPORT,
    frozenset((grasp.SCENE, grasp.HARD_PART)): _HARD,
    **{frozenset((grasp.SCENE, part)): _TABLE for part in (grasp.LEFT_PAD, grasp.RIGHT_PAD, grasp.FINGER)},
}
"""Which force a contact adds to, by the roles of its geoms."""


def standing_object(scene: Scene, kind: str, at: tuple[float, float]) -> tuple[SceneObject, int]:
    """Return an object that stands on the highest box below a point [m], and the slot of that box.

    Raises:
        ConfigError: There is no box.
    """
    tops = {}
    for slot in np.flatnonzero(scene.active[: scene.pool.first_cylinder]):
        offset = in_base(np.array(at), np.array([*scene.pos[slot, :2], scene.yaw[slot]]))
        if (np.abs(offset) < scene.half_size[slot, :2]).all():
            tops[int(slot)] = float(scene.pos[slot, 2] + scene.half_size[slot, 2])
    if not tops:
        raise ConfigError(f"robot.object_at: there is no box at {list(at)} to stand on")
    table = max(tops, key=tops.__getitem__)
    nominal = KINDS[kind]
    half = np.array(nominal.half_extents)
    pose = np.array([*at, tops[table] + half[2], 0.0])
    return SceneObject(kind, half, nominal.mass, PAD_FRICTION, pose), table


class HandledObject:
    """Reads forces and the object's place from the simulation.

    Attributes:
        start: Where its centre is at the start, world [m], shape (3,).
    """

    def __init__(
        self, scene: Scene, table: int, thing: SceneObject, model: mujoco.MjModel, contract: Contract
    ) -> None:
        """Look up geoms.

        Args:
            scene: Static; its world is the frame of the odometry.
            table: Slot that is the table.
            thing: The object.
            model: With the object.
            contract: Of the policy; gives the camera's field of view.
        """
        self.start = thing.start_pose[:3]
        self._model, self._roles = model, geom_roles(model)
        self._body = model.body(OBJECT_BODY).id
        self._tan_half_fov = [math.tan(math.radians(fov) / 2) for fov in contract.camera.fov_deg]
        self._length = float(np.linalg.norm(thing.half_extents))
        every = np.flatnonzero(scene.active)
        self._near, self._table = _slots(scene, every), _slots(scene, np.array([table]))
        self._sums = np.zeros(_NUM_SUMS)

    def clear(self) -> None:
        """Begin a control step."""
        self._sums[:] = 0.0

    def add_substep(self, data: mujoco.MjData) -> None:
        """Read the forces of a physics step; what touches the scene counts with its largest sum."""
        sums, force = np.zeros(_NUM_SUMS), np.zeros(6)
        for index, geoms in enumerate(data.contact.geom):
            column = _SUMS.get(frozenset(self._roles[int(geom)] for geom in geoms))
            if column is not None:
                mujoco.mj_contactForce(self._model, data, index, force)
                sums[column] += force[0]
        for column in (_TABLE, _HARD):
            sums[column] = max(sums[column], self._sums[column])
        self._sums = sums

    @property
    def grip(self) -> Grip:
        """Forces of the control step."""
        left, right, table, hard, support = self._sums.tolist()
        return Grip((left, right), table, hard, support > 0.0)

    def told(self, data: mujoco.MjData) -> Mapping[str, np.ndarray]:
        """Return what a fetch, and a policy that picks, are told; poses must be those of now."""
        hand = data.site(robot.GRASP_CENTER_SITE)
        at = data.xpos[self._body]
        velocity = np.zeros(6)
        mujoco.mj_objectVelocity(self._model, data, mujoco.mjtObj.mjOBJ_BODY, self._body, velocity, 0)
        known = Known(
            grip=self.grip,
            object_at=at.copy(),
            object_speed=float(np.linalg.norm(velocity[3:])),
            is_seen=self._is_seen(data, at),
            object_length=self._length,
            table=self._table,
            near=self._near,
        )
        is_told = known.is_seen * seen_object(at, data.qpos[:3], hand.xpos, hand.xmat.reshape(3, 3))
        return {**tell(known), _GROUP: is_told.astype(np.float32)[None]}

    def _is_seen(self, data: mujoco.MjData, at: np.ndarray) -> bool:
        """Whether the object's centre is in view, and nothing but the robot before it."""
        camera = data.site(robot.CAMERA_SITE)
        ray = at - camera.xpos
        x, y, z = camera.xmat.reshape(3, 3).T @ ray
        down, across = self._tan_half_fov
        if not (SIGHT_M[0] < z < SIGHT_M[1] and abs(x) < z * down and abs(y) < z * across):
            return False
        geom = np.full(1, -1, dtype=np.int32)
        groups = (np.arange(6) == SCENE_GROUP).astype(np.uint8)
        mujoco.mj_ray(self._model, data, camera.xpos, ray, groups, True, -1, geom)
        return geom[0] >= 0 and self._model.geom_bodyid[geom[0]] == self._body


def _slots(scene: Scene, chosen: np.ndarray) -> Slots:
    return Slots(scene.pos[chosen], scene.yaw[chosen], scene.half_size[chosen], scene.is_cylinder[chosen])
