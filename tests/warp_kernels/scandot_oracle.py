"""Scenes for the scandot tests, and a NumPy and C MuJoCo oracle that shares no formula with the kernel."""

from dataclasses import dataclass, fields

import mujoco
import numpy as np
import warp as wp

from spin_rl.warp_kernels.scandots import scandot_tokens
from spin_rl.warp_kernels.slots import Slots

WINDOW_M = 2.0
NEAR_M = 0.1
COLUMNS = 10
WALL, BOX, CYLINDER = 0, 1, 2


@dataclass
class Scene:
    """Arrays of all worlds, as the kernel takes them, in NumPy."""

    pos: np.ndarray
    yaw: np.ndarray
    half_size: np.ndarray
    active: np.ndarray
    kind: np.ndarray
    base: np.ndarray
    cam_pos: np.ndarray
    cam_mat: np.ndarray
    tan_half_fov: tuple[float, float] = (0.6, 0.9)

    def world(self, index: int) -> "Scene":
        """The same scene with one world only."""
        shared = {"kind", "tan_half_fov"}
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return Scene(**{k: v if k in shared else v[index : index + 1] for k, v in values.items()})


def rotation_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def camera_matrix(pan: float, tilt: float, roll: float = 0.0) -> np.ndarray:
    """Columns: image right, image down, forward, for a level camera that pans, tilts, then rolls."""
    forward = np.array([np.cos(pan) * np.cos(tilt), np.sin(pan) * np.cos(tilt), np.sin(tilt)])
    right = np.array([np.sin(pan), -np.cos(pan), 0.0])
    return np.stack([right, np.cross(forward, right), forward], axis=1) @ rotation_z(roll)


def scene_in_base_frame(slots, base, cam_pos, cam_mat, tan_half_fov) -> Scene:
    """One world from slots given in the base frame as (kind, pos, yaw, half_size, active)."""
    turn = rotation_z(base[2])
    origin = np.array([base[0], base[1], 0.0])
    kinds, pos, yaw, half, active = zip(*slots, strict=True)
    return Scene(
        pos=(np.array(pos) @ turn.T + origin)[None],
        yaw=(np.array(yaw) + base[2])[None],
        half_size=np.array(half, dtype=float)[None],
        active=np.array(active)[None],
        kind=np.array(kinds),
        base=np.array(base, dtype=float)[None],
        cam_pos=(turn @ np.array(cam_pos) + origin)[None],
        cam_mat=(turn @ cam_mat)[None],
        tan_half_fov=tan_half_fov,
    )


def random_scene(rng: np.random.Generator, num_worlds: int) -> Scene:
    """Unequal worlds of two or three walls, boxes and cylinders around a robot, some slots inactive."""
    kind = np.array([WALL] * 3 + [BOX] * 6 + [CYLINDER] * 3)
    shape = (num_worlds, len(kind))
    base = np.column_stack([rng.uniform(-3, 3, (num_worlds, 2)), rng.uniform(-9, 9, num_worlds)])
    angle, radius = rng.uniform(-np.pi, np.pi, shape), rng.uniform(0.6, 2.8, shape)
    radius[:, 0] += 1.0
    half = rng.uniform([0.05, 0.05, 0.05], [0.4, 0.4, 0.7], (*shape, 3))
    half[:, kind == CYLINDER, 1] = half[:, kind == CYLINDER, 0]
    is_wall = kind == WALL
    half[:, is_wall] = rng.uniform([1.0, 0.03, 0.3], [5.0, 0.06, 0.9], (num_worlds, is_wall.sum(), 3))
    half[:, 1, :2] = half[:, 1, 1::-1]  # this one is long along y
    xy = base[:, None, :2] + radius[..., None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    lift = np.where(rng.random(shape) < 0.3, rng.uniform(0, 0.6, shape), 0.0)
    cam_xy = base[:, :2] + rng.uniform(-0.1, 0.1, (num_worlds, 2))
    yaw = rng.uniform(-7, 7, shape)
    offset = cam_xy[:, None] - xy
    c, s = np.cos(yaw), np.sin(yaw)
    across = np.stack([c * offset[..., 0] + s * offset[..., 1], c * offset[..., 1] - s * offset[..., 0]], -1)
    holds_camera = np.all(np.abs(across) < half[..., :2], axis=-1)
    return Scene(
        pos=np.concatenate([xy, (half[..., 2] + lift)[..., None]], -1),
        yaw=yaw,
        half_size=half,
        active=(rng.random(shape) < 0.85) & ~holds_camera,
        kind=kind,
        base=base,
        cam_pos=np.column_stack([cam_xy, rng.uniform(0.9, 1.4, num_worlds)]),
        cam_mat=np.stack(
            [
                camera_matrix(base[w, 2] + rng.uniform(-2, 2), rng.uniform(-1.2, 0.2), rng.uniform(-2, 2))
                for w in range(num_worlds)
            ]
        ),
        tan_half_fov=(0.55, 0.95),
    )


@dataclass
class DeviceScene:
    """A scene on a device, with output buffers; ``launch`` runs the kernel once."""

    scene: Scene
    device: str
    occlusion: bool
    pieces_from: float = 0.0

    def __post_init__(self) -> None:
        s, device = self.scene, self.device
        num_worlds, num_slots = s.yaw.shape
        qpos = np.concatenate([s.base, np.full((num_worlds, 2), 7.0)], 1)
        # The camera is the second of three sites, so that a wrong index shows.
        sites = np.full((num_worlds, 3, 3), 5.0)
        sites[:, 1] = s.cam_pos
        frames = np.tile(np.eye(3), (num_worlds, 3, 1, 1))
        frames[:, 1] = s.cam_mat
        self.base = wp.array(qpos, dtype=float, device=device)
        slots = Slots()
        slots.pos = wp.array(s.pos, dtype=wp.vec3, device=device)
        slots.yaw = wp.array(s.yaw, dtype=float, device=device)
        slots.half_size = wp.array(s.half_size, dtype=wp.vec3, device=device)
        slots.active = wp.array(s.active, dtype=wp.bool, device=device)
        slots.is_cylinder = wp.array(s.kind == CYLINDER, dtype=wp.bool, device=device)
        self.arrays = [
            slots,
            wp.array(s.kind == WALL, dtype=wp.bool, device=device),
            wp.array(np.tile(np.arange(num_slots), (num_worlds, 1)), dtype=wp.int32, device=device),
            self.base,
            wp.array(sites, dtype=wp.vec3, device=device),
            wp.array(frames, dtype=wp.mat33, device=device),
        ]
        # NaN shows whatever the kernel leaves unwritten.
        self.all = wp.full((num_worlds, num_slots, 32), np.nan, dtype=float, device=device)
        self.visible = wp.full((num_worlds, num_slots, 32), np.nan, dtype=float, device=device)

    def launch(self) -> None:
        scandot_tokens(
            *self.arrays,
            camera_site=1,
            tan_half_fov=self.scene.tan_half_fov,
            near=NEAR_M,
            window=WINDOW_M,
            occlusion=self.occlusion,
            pieces_from=self.pieces_from,
            all_out=self.all,
            visible_out=self.visible,
        )

    def run(self) -> tuple[np.ndarray, np.ndarray]:
        self.launch()
        return self.all.numpy(), self.visible.numpy()


def to_base(scene: Scene, world: int, points: np.ndarray) -> np.ndarray:
    x, y, yaw = scene.base[world]
    return (points - [x, y, 0.0]) @ rotation_z(yaw)


def token_order(corners_b: np.ndarray) -> np.ndarray:
    """Indices that sort a box's corners (8, 3): nearest xy first, counter-clockwise, bottom, then top."""
    centre = corners_b[:, :2].mean(0)
    order = []
    for level in np.argsort(corners_b[:, 2], kind="stable").reshape(2, 4):
        angle = np.arctan2(*(corners_b[level, :2] - centre).T[::-1])
        turn = level[np.argsort(angle)]
        first = np.argmin(np.linalg.norm(corners_b[turn, :2], axis=1))
        order.extend(np.roll(turn, -first))
    return np.array(order)


def in_image(scene: Scene, world: int, points: np.ndarray) -> np.ndarray:
    x, y, z = ((points - scene.cam_pos[world]) @ scene.cam_mat[world]).T
    tan_x, tan_y = scene.tan_half_fov
    in_front = z >= NEAR_M
    safe = np.where(in_front, z, 1.0)
    return in_front & (np.abs(x / safe) <= tan_x) & (np.abs(y / safe) <= tan_y)


def box_corners(pos, yaw, half) -> np.ndarray:
    signs = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1], indexing="ij"), -1).reshape(8, 3)
    return pos + (signs * half) @ rotation_z(yaw).T


class Rays:
    """Line of sight by ``mujoco.mj_ray`` in a native model of one world."""

    def __init__(self, scene: Scene, world: int) -> None:
        spec = mujoco.MjSpec()
        for slot in np.flatnonzero(scene.active[world]):
            cylinder = scene.kind[slot] == CYLINDER
            half, yaw = scene.half_size[world, slot], scene.yaw[world, slot]
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CYLINDER if cylinder else mujoco.mjtGeom.mjGEOM_BOX,
                size=[half[0], half[2], 0.0] if cylinder else half,
                pos=scene.pos[world, slot],
                quat=[np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)],
            )
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self.data)
        self.origin = scene.cam_pos[world]

    def sees(self, point: np.ndarray, margin: float = 0.015) -> bool:
        ray = point - self.origin
        length = np.linalg.norm(ray)
        geom = np.zeros(1, dtype=np.int32)
        hit = mujoco.mj_ray(self.model, self.data, self.origin, ray / length, None, 1, -1, geom)
        return hit < 0.0 or hit >= length - margin

    def is_clear_cut(self, point: np.ndarray) -> bool:
        """Whether small changes of the target and of the margin leave the answer the same."""
        answers = [self.sees(point, margin) for margin in (0.013, 0.015, 0.017)]
        answers += [self.sees(point + 0.002 * step) for step in np.concatenate([np.eye(3), -np.eye(3)])]
        return len(set(answers)) == 1


def wall_samples(scene: Scene, world: int, slot: int):
    """Ends of the piece of a wall in the window, world points (2, 3) on the face's foot, or None."""
    corners = box_corners(scene.pos[world, slot], scene.yaw[world, slot], scene.half_size[world, slot])
    foot = corners[np.argsort(corners[:, 2], kind="stable")[:4]]
    # The two long sides as segments: pair each corner with the one along the long side.
    local_long = int(scene.half_size[world, slot, 1] > scene.half_size[world, slot, 0])
    long_axis = rotation_z(scene.yaw[world, slot])[:, local_long]
    across = rotation_z(scene.yaw[world, slot])[:, 1 - local_long]
    base = np.array([*scene.base[world, :2], 0.0])
    offsets = (foot - scene.pos[world, slot]) @ across
    towards = np.sign((base - scene.pos[world, slot]) @ across)
    near = foot[np.sign(offsets) == towards]
    start, end = near[np.argsort(near @ long_axis)]
    line = start + np.linspace(0, 1, 40001)[:, None] * (end - start)
    inside = np.all(np.abs(to_base(scene, world, line)[:, :2]) <= WINDOW_M, axis=1)
    return line[inside][[0, -1]] if inside.any() else None
