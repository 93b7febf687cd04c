"""Depth images by C MuJoCo's rays, and worlds to render: what the tests of the depth camera share."""

from types import SimpleNamespace

import mujoco
import numpy as np
import warp as wp

from spin_rl.sensors.depth.camera import DepthCamera

TAN = (0.9, 0.55)
SHAPE = (87, 58)
MAX_RANGE_M = 10.0
KINDS = {
    name: getattr(mujoco.mjtGeom, f"mjGEOM_{name.upper()}")
    for name in ("box", "sphere", "capsule", "ellipsoid", "cylinder", "plane")
}
_GROUPS = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)


def directions(tan=TAN, shape=SHAPE) -> np.ndarray:
    """Rays (x, y, 1) of the pixels in the optical frame, shape (rows, columns, 3)."""
    rows, columns = shape
    x = tan[0] * (2.0 * (np.arange(rows) + 0.5) / rows - 1.0)
    y = -tan[1] * (2.0 * (np.arange(columns) + 0.5) / columns - 1.0)
    return np.stack([*np.meshgrid(x, y, indexing="ij"), np.ones(shape)], -1)


def mujoco_hits(m, d, site, tan=TAN, shape=SHAPE, max_range=MAX_RANGE_M, shift=(0.0, 0.0)):
    """Geoms, -1 for none, and z-depths of one world by `mj_multiRay`; `shift` moves all rays in x and y."""
    rays = (directions(tan, shape) + [*shift, 0.0]).reshape(-1, 3)
    length = np.linalg.norm(rays, axis=1)
    world = (rays / length[:, None]) @ d.site_xmat[site].reshape(3, 3).T
    geom, distance = np.full(len(rays), -1, dtype=np.int32), np.zeros(len(rays))
    body = m.site_bodyid[site] or -1
    scene, far = (m, d), mujoco.mjMAXVAL
    mujoco.mj_multiRay(
        *scene, d.site_xpos[site], world.ravel(), _GROUPS, True, body, geom, distance, None, len(rays), far
    )
    depth = distance / length
    hit = (geom >= 0) & (depth <= max_range)
    return np.where(hit, geom, -1).reshape(shape), np.where(hit, depth, 0.0).reshape(shape)


def mujoco_depth(*args, **options) -> np.ndarray:
    """z-depth by `mujoco_hits`."""
    return mujoco_hits(*args, **options)[1]


def clear_cut(m, d, site, tan=TAN, shape=SHAPE, max_range=MAX_RANGE_M) -> np.ndarray:
    """Pixels whose depth does not depend on rounding: not at an edge, nor on a surface seen edge-on."""
    args = (m, d, site, tan, shape, max_range)
    depth = mujoco_depth(*args)
    sure = np.ones(shape, dtype=bool)
    for shift in ((1e-4, 0.0), (-1e-4, 0.0), (0.0, 1e-4), (0.0, -1e-4)):
        moved = mujoco_depth(*args, shift=shift)
        sure &= ((moved > 0.0) == (depth > 0.0)) & (np.abs(moved - depth) <= 0.02 * depth)
    return sure


def compile_world(solids, camera_pos=(0.0, 0.0, 0.0), camera_quat=(1.0, 0.0, 0.0, 0.0)):
    """Model and data of static geoms (kind, pos, quat, size) and a camera, by default at the origin."""
    spec = mujoco.MjSpec()
    for kind, pos, quat, size in solids:
        spec.worldbody.add_geom(type=KINDS[kind], pos=pos, quat=quat, size=np.resize([*size, 0.0, 0.0], 3))
    spec.worldbody.add_site(name="camera", pos=camera_pos, quat=camera_quat)
    m = spec.compile()
    d = mujoco.MjData(m)
    mujoco.mj_kinematics(m, d)
    return m, d


class Worlds:
    """Compiled worlds with geoms of the same kinds, and a camera in all of them."""

    def __init__(self, worlds, device, **options):
        self.native = worlds
        self.m = worlds[0][0]
        self.model = SimpleNamespace(
            geom_size=self._array([m.geom_size for m, _ in worlds], wp.vec3, device),
            geom_type=wp.array(self.m.geom_type, dtype=wp.int32, device=device),
        )
        self.data = SimpleNamespace(
            geom_xpos=self._array([d.geom_xpos for _, d in worlds], wp.vec3, device),
            geom_xmat=self._array([d.geom_xmat.reshape(-1, 3, 3) for _, d in worlds], wp.mat33, device),
            site_xpos=self._array([d.site_xpos for _, d in worlds], wp.vec3, device),
            site_xmat=self._array([d.site_xmat.reshape(-1, 3, 3) for _, d in worlds], wp.mat33, device),
            xpos=self._array([d.xpos for _, d in worlds], wp.vec3, device),
            xmat=self._array([d.xmat.reshape(-1, 3, 3) for _, d in worlds], wp.mat33, device),
        )
        options = {"tan_half_fov": TAN, "shape": SHAPE, "max_range": MAX_RANGE_M, **options}
        self.camera = DepthCamera(self.m, self.model, self.data, camera_site=0, **options)

    def render(self, mask=None) -> np.ndarray:
        self.camera.update(mask)
        return self.camera.depth.numpy().copy()

    @staticmethod
    def _array(values, dtype, device):
        return wp.array(np.array(values, dtype=np.float32), dtype=dtype, device=device)


def random_quat(rng) -> np.ndarray:
    quat = rng.normal(size=4)
    return quat / np.linalg.norm(quat)


def random_world(rng, kinds, floor=True):
    """Solids of any turn and size around a camera that looks anywhere."""
    solids = [
        (kind, rng.uniform([-3, -3, 0], [3, 3, 2]), random_quat(rng), rng.uniform(0.05, 0.5, 3))
        for kind in kinds
    ]
    if floor:
        solids.append(("plane", (0, 0, 0), (1, 0, 0, 0), (0, 0, 1)))
    return compile_world(solids, rng.uniform([-3, -3, 0.3], [3, 3, 2]), random_quat(rng))
