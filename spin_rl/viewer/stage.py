"""The robot and one scene as an ordinary MuJoCo model on the host: poses, cameras and rays for pictures."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import mujoco
import numpy as np

from spin_rl import robot
from spin_rl.scenes.builder import PARKED_Z_M, SCENE_GROUP, add_pool, native_model
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.scenes.objects.shapes import OBJECT_GEOMS, SceneObject, add_object
from spin_rl.viewer import style
from spin_rl.viewer.rollout import Player
from spin_rl.viewer.snapshot import Snapshot

VISUAL_GROUP = 2
VIEW = "follow"
"""Name of the camera that follows the robot; `Stage.place_view` moves it."""

_LOW_WALL_M = 0.22
_GOAL_Z_M = 0.004  # of the goal marker's centre: it lies on the floor
_UNUSED_M = 1.0e-4  # size of the object's geoms that have no part in its shape


@dataclass(frozen=True)
class DepthCamera:
    """The robot's depth camera.

    Attributes:
        pos: Optical centre [m], world, shape (3,).
        mat: Rotation of the optical frame (x image right, y down, z forward) to the world, shape (3, 3).
        tan_half_fov: Tangents of half the field of view along the optical x and y axes.
    """

    pos: np.ndarray
    mat: np.ndarray
    tan_half_fov: tuple[float, float]

    def frustum(self, length: float) -> np.ndarray:
        """Apex and the four corners at a depth [m], in order around the image, world, shape (5, 3)."""
        tan_x, tan_y = self.tan_half_fov
        corners = [(sx * tan_x, sy * tan_y, 1.0) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        local = np.array([(0.0, 0.0, 0.0), *corners]) * length
        return self.pos + local @ self.mat.T


class Stage:
    """Holds one model for all scenes of a pool; `load` writes a scene, `pose` robot and object.

    Attributes:
        model: Robot, floor, pool, object if any, goal marker, light and cameras.
        data: Its state; poses are those of the last `pose`.
    """

    def __init__(self, pool: PoolSpec, camera_mount: robot.CameraMount, *, with_object: bool = False) -> None:
        """Compile the model.

        Args:
            pool: Slots of the scenes to come.
            camera_mount: "portrait" or "landscape".
            with_object: Whether there is an object to pick up in the snapshots to come.
        """
        self.pool = pool
        self._tan_half_fov = robot.camera_tan_half_fov(camera_mount)
        self.model = _spec(pool, with_object).compile()
        self.data = mujoco.MjData(self.model)
        self._geoms = np.array([self.model.geom(name).id for name in pool.geom_names()])
        self._goal = self.model.geom("goal").id
        names = OBJECT_GEOMS if with_object else ()
        self._object_geoms = np.array([self.model.geom(name).id for name in names], dtype=int)
        # Compiled as "same frame as the body" where the pose allows; the poses written below do not.
        written = [*self._geoms, *self._object_geoms, self._goal]
        self.model.geom_sameframe[written] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE
        self.scene = Scene.empty(pool)
        self._object: SceneObject | None = None

    def load(self, scene: Scene) -> None:
        """Write a scene of the stage's pool into the model."""
        model = self.model
        self.scene = scene
        for slot, geom in enumerate(self._geoms):
            half, yaw = scene.half_size[slot], 0.5 * scene.yaw[slot]
            model.geom_pos[geom] = scene.pos[slot] if scene.active[slot] else (0.0, 0.0, PARKED_Z_M)
            model.geom_quat[geom] = (np.cos(yaw), 0.0, 0.0, np.sin(yaw))
            size = (half[0], half[2], 0.0) if scene.is_cylinder[slot] else half
            model.geom_size[geom] = size
            model.geom_rbound[geom] = np.linalg.norm(half)
            model.geom_aabb[geom] = (0.0, 0.0, 0.0, *half)
        model.geom_rgba[self._geoms, :3] = np.array(style.slot_colours(scene)) / 255
        model.geom_pos[self._goal, :2] = scene.goal

    @property
    def object_geoms(self) -> np.ndarray:
        """Geoms that make the present object's shape."""
        return self._object_geoms[self.model.geom_size[self._object_geoms, 0] > _UNUSED_M]

    def _shape(self, what: SceneObject) -> None:
        """Give the object's geoms the poses and sizes that MuJoCo's compiler gives those of its kind."""
        shape = _compiled_shape(what.kind, tuple(float(half) for half in what.half_extents))
        for geom, name in zip(self._object_geoms, OBJECT_GEOMS, strict=True):
            self.model.geom_size[geom] = _UNUSED_M
            self.model.geom_pos[geom] = 0.0
            for field, value in shape.get(name, {}).items():
                getattr(self.model, field)[geom] = value
        self._object = what

    def pose(self, snapshot: Snapshot) -> None:
        """Put robot and object where they are in a snapshot, in the snapshot's scene."""
        if snapshot.scene is not self.scene:
            self.load(snapshot.scene)
        target = snapshot.target
        if target is not None and target.what is not self._object:
            self._shape(target.what)
        # The goal of a task with scandots; others have none to drive to.
        self.model.geom_pos[self._goal, 2] = _GOAL_Z_M if snapshot.scandots is not None else PARKED_Z_M
        self.data.qpos[:] = snapshot.qpos if target is None else [*snapshot.qpos, *target.pose]
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    def depth_camera(self) -> DepthCamera:
        """The robot's depth camera at the present pose."""
        site = self.data.site(robot.CAMERA_SITE)
        return DepthCamera(site.xpos.copy(), site.xmat.reshape(3, 3).copy(), self._tan_half_fov)

    def depth_image(self, height: int) -> np.ndarray:
        """What the depth camera would measure of the scene, upright.

        Args:
            height: Rows; the columns follow from the field of view.

        Returns:
            Distance along the optical axis [m], infinite where there is nothing, shape (height, width). The
            robot itself is left out.
        """
        camera = self.depth_camera()
        tan_x, tan_y = camera.tan_half_fov
        width = round(height * tan_y / tan_x)
        # Upright, rows run along the optical x axis, and columns against its y axis (portrait mount).
        rows = (np.arange(height) + 0.5) / height * 2 - 1
        columns = 1 - (np.arange(width) + 0.5) / width * 2
        x, y = np.meshgrid(rows * tan_x, columns * tan_y, indexing="ij")
        rays = np.stack((x, y, np.ones_like(x)), -1).reshape(-1, 3) @ camera.mat.T
        group = np.zeros(6, dtype=np.uint8)
        group[SCENE_GROUP] = 1
        count = len(rays)
        geom, distance = np.zeros(count, dtype=np.int32), np.zeros(count)
        # Rays advance one metre of depth per unit, so that distances are depths.
        mujoco.mj_multiRay(
            self.model, self.data, camera.pos, rays.ravel(), group, True, -1, geom, distance, None, count, 1e3
        )
        return np.where(geom < 0, np.inf, distance).reshape(height, width)

    def place_view(self, pos: np.ndarray, look_at: np.ndarray) -> None:
        """Move the following camera: its place and what it looks at [m], world; effective at once."""
        camera = self.model.camera(VIEW).id
        back = (pos - look_at) / np.linalg.norm(pos - look_at)
        right = np.cross((0.0, 0.0, 1.0), back)
        right /= np.linalg.norm(right)
        self.data.cam_xpos[camera] = pos
        self.data.cam_xmat[camera] = np.stack((right, np.cross(back, right), back), -1).ravel()

    def low_walls(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions and sizes of all geoms with the walls cut low, so that they hide nothing.

        Returns:
            `geom_xpos` and `geom_size` [m], shape (ngeom, 3) each.
        """
        xpos, size = self.data.geom_xpos.copy(), self.model.geom_size.copy()
        walls = self._geoms[self.scene.is_wall & self.scene.active]
        size[walls, 2] = np.minimum(size[walls, 2], 0.5 * _LOW_WALL_M)
        xpos[walls, 2] = size[walls, 2]
        return xpos, size


@functools.lru_cache(maxsize=32)  # several worlds take turns on one stage
def _compiled_shape(kind: str, half_extents: tuple[float, float, float]) -> dict[str, dict[str, np.ndarray]]:
    """Fields of the geoms that MuJoCo's compiler makes of an object, by geom and field."""
    what = SceneObject(kind, np.array(half_extents), mass=0.1, friction=1.0, start_pose=np.zeros(4))
    native = native_model(Scene.empty(PoolSpec()), obj=what)
    fields = ("geom_pos", "geom_quat", "geom_size", "geom_rbound", "geom_aabb")
    names = {native.geom(geom).name: geom for geom in range(native.ngeom)}
    return {
        name: {field: getattr(native, field)[names[name]].copy() for field in fields}
        for name in OBJECT_GEOMS
        if name in names
    }


def stage_of(player: Player) -> Stage:
    """Return a stage for the snapshots of a player."""
    env = player.env
    with_object = player.snapshots[0].target is not None
    return Stage(env.sim.layout.pool, env.cfg.camera_mount, with_object=with_object)


def _spec(pool: PoolSpec, with_object: bool) -> mujoco.MjSpec:
    spec = robot.load_grasp_spec() if with_object else robot.load_spec()
    add_pool(spec, pool)
    if with_object:
        add_object(spec)
    world = spec.worldbody
    spec.add_texture(
        name="tiles",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[c / 255 for c in style.FLOOR],
        rgb2=[0.95 * c / 255 for c in style.FLOOR],
        width=128,
        height=128,
    )
    textures = [""] * mujoco.mjtTextureRole.mjNTEXROLE
    textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "tiles"
    spec.add_material(name="tiles", textures=textures, texrepeat=[1, 1], texuniform=True)
    floor = spec.geom("floor")
    floor.material = "tiles"
    floor.rgba = [0.5, 0.5, 0.5, 1.0]  # MuJoCo's default: the material's colour counts
    world.add_geom(
        name="goal",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[0.15, _GOAL_Z_M, 0.0],
        pos=[0.0, 0.0, _GOAL_Z_M],
        contype=0,
        conaffinity=0,
        group=VISUAL_GROUP,
        rgba=[*(c / 255 for c in style.GOAL), 1.0],
    )
    world.add_light(
        pos=[0.0, 0.0, 6.0],
        dir=[0.35, 0.25, -1.0],
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        diffuse=[0.55, 0.55, 0.55],
        specular=[0.1, 0.1, 0.1],
        castshadow=True,
    )
    spec.visual.headlight.ambient = [0.42, 0.42, 0.42]
    spec.visual.headlight.diffuse = [0.25, 0.25, 0.25]
    spec.visual.headlight.specular = [0.0, 0.0, 0.0]
    world.add_camera(name=VIEW, pos=[-2.0, 0.0, 2.0], fovy=45.0)
    return spec
