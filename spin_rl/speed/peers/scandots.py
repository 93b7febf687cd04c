"""The peer of the scandot kernel: the same tokens by plain NumPy, lines of sight by C MuJoCo's `mj_multiRay`.

For boxes and cylinders; walls are not covered. The rules are those of `spin_rl.warp_kernels.scandots`.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from spin_rl.scenes.layout import Layout

# Rays stop this far before their target, so that its own surface does not hide it; as in the kernel.
_SIGHT_MARGIN_M = 0.015


@dataclass
class HostWorlds:
    """Inputs of the kernel on the host, float32.

    Attributes:
        pos: Slot centres [m], shape (nworld, nslot, 3).
        yaw: Slot yaws [rad], shape (nworld, nslot).
        half_size: Half extents [m], shape (nworld, nslot, 3).
        base: Base x, y [m] and yaw [rad], shape (nworld, 3).
        cam_pos: Camera positions [m], shape (nworld, 3).
        cam_mat: Camera-to-world rotations, shape (nworld, 3, 3).
        tan_half_fov: Tangents of half the field of view along the optical x and y axes.
        window: Half side of the local window [m].
        near: Smallest depth seen [m].
    """

    pos: np.ndarray
    yaw: np.ndarray
    half_size: np.ndarray
    base: np.ndarray
    cam_pos: np.ndarray
    cam_mat: np.ndarray
    tan_half_fov: tuple[float, float]
    window: float
    near: float


def scandot_tokens_numpy(
    worlds: HostWorlds, sight: list[SightModel] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Tokens of the local window and of what the camera sees.

    Args:
        worlds: Inputs; every slot is an active box or cylinder.
        sight: One model a world, which removes the corners that are hidden; None leaves them.

    Returns:
        Both tokens, each of shape (nworld, nslot, 32).
    """
    cos, sin = np.cos(worlds.yaw), np.sin(worlds.yaw)
    base_xy = worlds.base[:, None, :2]
    # Signs of the vertical edge nearest to the base, and of the next ones a quarter turn on each.
    local = _turn(base_xy - worlds.pos[..., :2], cos, -sin)
    x, y = np.where(local < 0.0, -1.0, 1.0).astype(np.float32).transpose(2, 0, 1)
    signs = np.stack([np.stack(s, -1) for s in ((x, y), (-y, x), (-x, -y), (y, -x))], 2)
    edges = _turn(signs * worlds.half_size[:, :, None, :2], cos[..., None], sin[..., None])
    edges += worlds.pos[:, :, None, :2]
    heights = worlds.pos[..., 2:] + worlds.half_size[..., 2:] * np.array([-1.0, 1.0], dtype=np.float32)
    corners = np.concatenate([np.tile(edges, (1, 1, 2, 1)), np.repeat(heights, 4, -1)[..., None]], -1)

    base_cos, base_sin = np.cos(worlds.base[:, 2]), np.sin(worlds.base[:, 2])
    xy_b = _turn(corners[..., :2] - base_xy[:, None], base_cos[:, None, None], -base_sin[:, None, None])
    corners_b = np.concatenate([xy_b, corners[..., 2:]], -1)
    inside = np.all(np.abs(xy_b) <= worlds.window, axis=-1)

    in_cam = (corners - worlds.cam_pos[:, None, None]) @ worlds.cam_mat[:, None]
    depth = in_cam[..., 2]
    tan_x, tan_y = worlds.tan_half_fov
    visible = inside & (depth >= worlds.near)
    visible &= (np.abs(in_cam[..., 0]) <= tan_x * depth) & (np.abs(in_cam[..., 1]) <= tan_y * depth)
    if sight is not None:
        for world, model in enumerate(sight):
            visible[world][visible[world]] = model.sees(worlds.cam_pos[world], corners[world][visible[world]])
    return _tokens(corners_b, inside), _tokens(corners_b, visible)


class SightModel:
    """One world's slots as an ordinary MuJoCo model to cast rays in."""

    def __init__(self, layout: Layout, world: int) -> None:
        """Compile the active slots of a world."""
        scene = layout.scene(world)
        spec = mujoco.MjSpec()
        for slot in np.flatnonzero(scene.active):
            half, yaw = scene.half_size[slot], scene.yaw[slot]
            cylinder = bool(scene.is_cylinder[slot])
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CYLINDER if cylinder else mujoco.mjtGeom.mjGEOM_BOX,
                size=[half[0], half[2], 0.0] if cylinder else list(half),
                pos=list(scene.pos[slot]),
                quat=[np.cos(0.5 * yaw), 0.0, 0.0, np.sin(0.5 * yaw)],
            )
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, self._data)

    def sees(self, camera: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Whether nothing stands between the camera and world points (n, 3), shape (n,), bool."""
        count = len(points)
        rays = (points - camera).astype(np.float64)
        length = np.linalg.norm(rays, axis=1)
        geom, hit = np.full(count, -1, dtype=np.int32), np.full(count, -1.0)
        if count:
            rays /= length[:, None]
            scene, far = (self._model, self._data), mujoco.mjMAXVAL
            mujoco.mj_multiRay(*scene, camera, rays.ravel(), None, True, -1, geom, hit, None, count, far)
        return (hit < 0.0) | (hit >= length - _SIGHT_MARGIN_M)


def _turn(xy: np.ndarray, cos: np.ndarray, sin: np.ndarray) -> np.ndarray:
    return np.stack([cos * xy[..., 0] - sin * xy[..., 1], sin * xy[..., 0] + cos * xy[..., 1]], -1)


def _tokens(corners: np.ndarray, known: np.ndarray) -> np.ndarray:
    flat = (corners * known[..., None]).reshape(*known.shape[:-1], -1)
    return np.concatenate([flat, known.astype(np.float32)], -1, dtype=np.float32)
