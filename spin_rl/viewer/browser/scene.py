"""One world in viser's scene tree: the robot from primitives, the scene, and the overlays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from spin_rl.scenes.layout import Scene
from spin_rl.scenes.objects.shapes import OBJECT_BODY, SceneObject
from spin_rl.viewer import style
from spin_rl.viewer.overlay import FRUSTUM_LENGTH_M
from spin_rl.viewer.snapshot import Snapshot, Target
from spin_rl.viewer.stage import VISUAL_GROUP, DepthCamera, Stage

_WALL_OPACITY = 0.28
_GOAL_Z_M = 0.005
_SEEN_SIZE_M = 0.035
_UNSEEN_SIZE_M = 0.018


class WorldView:
    """Draws one world below a node of its own; bodies move, their geoms are sent once."""

    def __init__(self, server: Any, stage: Stage, name: str) -> None:
        """Add the robot.

        Args:
            server: viser's server.
            stage: Poses the robot; shared by all worlds.
            name: Name of the node, such as "/world_0".
        """
        self._scene_api = server.scene
        self._stage = stage
        self._name = name
        self._scene: Scene | None = None
        self._goal: Any = None
        self._slots: dict[int, Any] = {}
        self._object: SceneObject | None = None
        self._object_root: Any = None
        self._root = server.scene.add_frame(name, show_axes=False)
        self._bodies = self._add_robot()
        # Two clouds: what is seen is drawn larger.
        self._dots = {
            seen: server.scene.add_point_cloud(
                f"{name}/scandots/{'seen' if seen else 'unseen'}",
                points=np.zeros((0, 3), dtype=np.float32),
                colors=style.SEEN if seen else style.UNSEEN,
                point_size=_SEEN_SIZE_M if seen else _UNSEEN_SIZE_M,
                point_shape="circle",
                precision="float32",
            )
            for seen in (False, True)
        }
        self._frustum = self._add_frustum(stage.depth_camera().tan_half_fov)

    def update(self, snapshot: Snapshot, origin: np.ndarray) -> None:
        """Show a snapshot; a new scene replaces the old one, and what moves is moved.

        Args:
            snapshot: What to show.
            origin: Where to show the world's origin (x, y) [m], shape (2,).
        """
        self._root.position = (*origin, 0.0)
        scene, before = snapshot.scene, self._scene
        if scene is not before:
            self._scene = scene
            # Scenes of one episode share everything but positions and goal.
            if before is None or scene.half_size is not before.half_size:
                self._add_scene(scene, has_goal=snapshot.scandots is not None)
            for slot, handle in self._slots.items():
                handle.position = scene.pos[slot]
            if self._goal is not None:
                self._goal.position = (*scene.goal, _GOAL_Z_M)
        stage = self._stage
        stage.pose(snapshot)
        for body, handle in self._bodies.items():
            handle.position = stage.data.xpos[body]
            handle.wxyz = stage.data.xquat[body]
        if snapshot.target is not None:
            self._show_object(snapshot.target)
        camera = stage.depth_camera()
        self._frustum.position = camera.pos
        self._frustum.wxyz = quaternion(camera.mat)
        marks = snapshot.marks
        for seen, cloud in self._dots.items():
            points = marks.points[marks.seen == seen].astype(np.float32)
            cloud.points = points
            cloud.colors = np.tile(np.array(style.SEEN if seen else style.UNSEEN, np.uint8), (len(points), 1))

    def _add_robot(self) -> dict[int, Any]:
        model = self._stage.model
        bodies = {}
        for geom in np.flatnonzero((model.geom_group == VISUAL_GROUP) & (model.geom_bodyid > 0)):
            body = int(model.geom_bodyid[geom])
            node = f"{self._name}/robot/{model.body(body).name}"
            if body not in bodies:
                bodies[body] = self._scene_api.add_frame(node, show_axes=False)
            self._add_geoms(np.array([geom]), node)
        return bodies

    def _add_frustum(self, tan_half_fov: tuple[float, float]) -> Any:
        """Add the frustum's edges in the optical frame; viser's own frustum has another length."""
        apex, *corners = DepthCamera(np.zeros(3), np.eye(3), tan_half_fov).frustum(FRUSTUM_LENGTH_M)
        edges = [(apex, corner) for corner in corners]
        edges += [(corners[i], corners[(i + 1) % 4]) for i in range(4)]
        return self._scene_api.add_line_segments(
            f"{self._name}/depth_camera",
            points=np.array(edges, dtype=np.float32),
            colors=style.FRUSTUM,
            thickness=0.01,
        )

    def _add_goal(self) -> Any:
        return self._scene_api.add_cylinder(
            f"{self._name}/goal",
            radius=0.15,
            height=2.0 * _GOAL_Z_M,
            color=style.GOAL,
            cast_shadow=False,
        )

    def _show_object(self, target: Target) -> None:
        """Move the object; a new one replaces the old one. The stage has the pose of the snapshot."""
        if target.what is not self._object:
            self._object = target.what
            if self._object_root is not None:
                self._object_root.remove()
            node = f"{self._name}/{OBJECT_BODY}"
            self._object_root = self._scene_api.add_frame(node, show_axes=False)
            self._add_geoms(self._stage.object_geoms, node)
        self._object_root.position = target.pose[:3]
        self._object_root.wxyz = target.pose[3:]

    def _add_geoms(self, geoms: np.ndarray, node: str) -> None:
        model = self._stage.model
        for geom in geoms:
            _add_geom(
                self._scene_api,
                f"{node}/{model.geom(geom).name}",
                int(model.geom_type[geom]),
                model.geom_size[geom],
                _rgb(model.geom_rgba[geom]),
                position=model.geom_pos[geom],
                wxyz=model.geom_quat[geom],
            )

    def _add_scene(self, scene: Scene, *, has_goal: bool) -> None:
        for handle in (self._goal, *self._slots.values()):
            if handle is not None:
                handle.remove()
        self._goal = self._add_goal() if has_goal else None
        self._slots = {}
        names, colours = scene.pool.geom_names(), style.slot_colours(scene)
        for slot in np.flatnonzero(scene.active):
            half, yaw, wall = scene.half_size[slot], 0.5 * scene.yaw[slot], bool(scene.is_wall[slot])
            cylinder = bool(scene.is_cylinder[slot])
            self._slots[int(slot)] = _add_geom(
                self._scene_api,
                f"{self._name}/scene/{names[slot]}",
                mujoco.mjtGeom.mjGEOM_CYLINDER if cylinder else mujoco.mjtGeom.mjGEOM_BOX,
                (half[0], half[2], 0.0) if cylinder else half,
                colours[slot],
                position=scene.pos[slot],
                wxyz=(np.cos(yaw), 0.0, 0.0, np.sin(yaw)),
                opacity=_WALL_OPACITY if wall else None,
                cast_shadow=not wall,
            )


def _add_geom(
    scene_api: Any,
    name: str,
    kind: int,
    size: Sequence[float] | np.ndarray,
    colour: style.Rgb,
    **options: Any,
) -> Any:
    """Add a MuJoCo geom; capsules are shown as cylinders of their full length.

    Raises:
        ValueError: The kind is none of box, cylinder, capsule and sphere.
    """
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return scene_api.add_box(
            name, color=colour, dimensions=tuple(2.0 * float(s) for s in size), **options
        )
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        height = 2.0 * float(size[1])
    elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        height = 2.0 * float(size[1] + size[0])
    elif kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return scene_api.add_icosphere(name, radius=float(size[0]), color=colour, **options)
    else:
        raise ValueError(f"{name}: geoms of type {kind} cannot be shown")
    return scene_api.add_cylinder(name, radius=float(size[0]), height=height, color=colour, **options)


def _rgb(rgba: np.ndarray) -> style.Rgb:
    red, green, blue = (round(255 * float(c)) for c in rgba[:3])
    return red, green, blue


def quaternion(mat: np.ndarray) -> np.ndarray:
    """Quaternion (w, x, y, z) of a rotation matrix (3, 3)."""
    result = np.zeros(4)
    mujoco.mju_mat2Quat(result, np.ascontiguousarray(mat).ravel())
    return result
