"""Random trips through a scene: starts and goals between which the planner finds a way.

Needs the `planner` extra (SciPy), as the planner does.
"""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from spin_rl import robot
from spin_rl.extras import require
from spin_rl.planning.lattice import RESOLUTION_M, reachable
from spin_rl.scenes.builder import native_model
from spin_rl.scenes.corridors.params import GeneratorParams, start_ranges
from spin_rl.scenes.layout import Scene

SHORTEST_M = 1.0
"""Least straight distance from start to goal."""

MARGIN_M = 0.05
"""What starts and goals keep from everything."""

SEARCH_RESOLUTION_M = 0.08
"""Of the planner's lattice: a quarter of the usual one's time, and ways that leave room on either side."""

_YAWS = np.linspace(-np.pi, np.pi, 24, endpoint=False)
_ROUNDS = 20
_DRAWN = 500
"""So many places are drawn so often, before the scene counts as too full."""
_SPARE = 10
"""Places more than are needed, since a goal must be far from its start."""
_JOINT_TRIES = 16
_TRACK_M = 0.6
"""What starts and goals keep from where things move."""


def draw_trips(scene: Scene, count: int, params: GeneratorParams, *, seed: int) -> list[Scene]:
    """Draw random starts and goals in a scene; all depends on nothing but the arguments.

    Starts and goals are places where the robot, arm stowed, can turn on the spot and which can be driven to
    from the scene's own start. The yaw is random; so are the arm's joints, where they touch nothing.

    Args:
        scene: The world; its start says which of its parts are meant, its goal is ignored.
        count: Trips.
        params: Ranges of the joints at the start.
        seed: Random seed.

    Returns:
        The scene with each start and goal.

    Raises:
        ValueError: The scene has not enough room.
        ConfigError: SciPy is not installed.
    """
    rng = np.random.default_rng(seed)
    robot_here = _Robot(scene)
    places = _draw_places(scene, robot_here, 2 * count + _SPARE, rng)
    starts, goals = places[:count], _draw_goals(places, count, rng)
    trips = []
    for start, goal in zip(starts, goals, strict=True):
        pose = np.array([*start, rng.uniform(-np.pi, np.pi)])
        joints = _draw_joints(robot_here, pose, params, rng)
        trips.append(replace(scene, start=pose, start_joints=joints, goal=goal))
    return trips


def has_way(scene: Scene) -> bool:
    """Whether the planner finds a way from a scene's start to its goal.

    Raises:
        ConfigError: SciPy is not installed.
    """
    require("scipy.sparse", "SciPy", "planner", "scene")
    return any(reachable(scene, scene.goal[None], step)[0] for step in (SEARCH_RESOLUTION_M, RESOLUTION_M))


class _Robot:
    """Says which poses of the robot keep their distance from a scene's slots."""

    def __init__(self, scene: Scene) -> None:
        self._model = native_model(scene)
        self._model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_OVERRIDE
        self._model.opt.o_margin = MARGIN_M
        self._data = mujoco.MjData(self._model)
        names = zip(scene.pool.geom_names(), scene.active, strict=True)
        self._slots = [self._model.geom(name).id for name, is_there in names if is_there]

    def is_clear(self, pose: np.ndarray, joints: np.ndarray) -> bool:
        """Whether a base pose (x, y, yaw) with joints in `robot.JOINTS` order is clear."""
        values = {str(joint): float(at) for joint, at in zip(robot.JOINTS, joints, strict=True)}
        self._data.qpos[:] = robot.qpos_from_joints(self._model, values)
        self._data.qpos[:3] = pose
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_collision(self._model, self._data)
        return not np.isin(self._data.contact.geom, self._slots).any()

    def can_turn(self, place: np.ndarray) -> bool:
        """Whether the stowed robot can turn on the spot."""
        return all(self.is_clear(np.array([*place, yaw]), _STOWED) for yaw in _YAWS)


_STOWED = np.array([robot.STOWED[joint] for joint in robot.JOINTS])


def _draw_places(scene: Scene, robot_here: _Robot, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draw places that can be driven to, shape (count, 2)."""
    require("scipy.sparse", "SciPy", "planner", "starts")
    ends = np.stack([scene.start[:2], scene.goal, *scene.pos[scene.active, :2]])
    low, high = ends.min(axis=0), ends.max(axis=0)
    found = np.zeros((0, 2))
    for _ in range(_ROUNDS):
        drawn = rng.uniform(low, high, (_DRAWN, 2))
        turning = [place for place in drawn if robot_here.can_turn(place) and _is_calm(scene, place)]
        if turning:
            places = np.array(turning[: 2 * count])  # asking the planner takes longer than drawing
            found = np.concatenate([found, places[reachable(scene, places, SEARCH_RESOLUTION_M)]])
        if len(found) >= count:
            return found[:count]
    raise ValueError(f"scene: only {len(found)} of {count} places to start from and drive to have a way")


def _is_calm(scene: Scene, place: np.ndarray) -> bool:
    """Whether nothing moves near a place."""
    for slot in np.flatnonzero(scene.active & (scene.motion_speed > 0.0)):
        home, way = scene.home[slot, :2], scene.retreat[slot]
        along = np.clip(np.dot(place - home, way) / max(np.dot(way, way), 1e-9), 0.0, 1.0)
        if np.linalg.norm(place - home - along * way) < _TRACK_M + scene.half_size[slot, :2].max():
            return False
    return True


def _draw_goals(places: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Give each of the first places another one that is far enough, shape (count, 2)."""
    goals = []
    for start in places[:count]:
        far = places[np.linalg.norm(places - start, axis=1) >= SHORTEST_M]
        if len(far) == 0:
            raise ValueError(f"scene: no two places with a way lie {SHORTEST_M} m apart")
        goals.append(rng.choice(far))
    return np.array(goals)


def _draw_joints(
    robot_here: _Robot, pose: np.ndarray, params: GeneratorParams, rng: np.random.Generator
) -> np.ndarray:
    """Draw joints within the start ranges that are clear at a pose; else stowed, the camera anywhere."""
    low, high = start_ranges(params)
    for _ in range(_JOINT_TRIES):
        joints = rng.uniform(low, high)
        if robot_here.is_clear(pose, joints):
            return joints
    camera = [robot.JOINTS.index(joint) for joint in robot.CAMERA_JOINTS]
    stowed = _STOWED.copy()
    stowed[camera] = rng.uniform(low, high)[camera]
    return stowed
