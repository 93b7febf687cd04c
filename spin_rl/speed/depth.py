"""Speed of the depth camera beside C MuJoCo's rays and mujoco_warp's renderer, and where its time goes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from spin_rl import robot
from spin_rl.scenes.builder import native_model
from spin_rl.sensors.depth.camera import DepthCamera
from spin_rl.sim.graph import StepGraph
from spin_rl.speed.peers.depth import BatchRenderer, NativeRays, check_agreement
from spin_rl.speed.rows import Row, cost_row
from spin_rl.speed.timing import Stopwatch, Subject, interleave
from spin_rl.tasks.nav.env import NavEnv
from spin_rl.warp_kernels.depth import project as kinds

WORLD_COUNTS = (1, 64, 256)
TILT = -0.6
NUM_PRIMITIVES = 30
MAX_RANGE_M = 10.0
_CAMERA_HEIGHT_M = 1.3
_NATIVE_WORLDS = 4  # models that C MuJoCo compiles one by one
_HARD = 2
_UNIT = "us/frame"
_RAYS, _RENDER = "C MuJoCo mj_multiRay", "mujoco_warp.render"
_SOLIDS = tuple(
    getattr(mujoco.mjtGeom, f"mjGEOM_{kind}")
    for kind in ("BOX", "CYLINDER", "CAPSULE", "SPHERE", "ELLIPSOID")
)
# Operations at a pixel beside a multiplication and an addition for each line: comparisons, selections, roots.
_LINES = {int(kinds.PLANE): 1, int(kinds.ELLIPSOID): 3, int(kinds.CYLINDER): 4, int(kinds.CAPSULE): 10}
_BOX_LINES = 6
_OTHER = {int(kinds.PLANE): 1, int(kinds.ELLIPSOID): 14, int(kinds.CYLINDER): 20, int(kinds.CAPSULE): 60}
_BOX_OTHER = 7


@dataclass
class DepthWorlds:
    """Worlds to look at.

    Attributes:
        mj_model: Their model.
        model: Of all worlds.
        data: With current poses.
        native: The first of them as ordinary models.
        site: Name of the camera's optical frame.
        camera: Name of a camera with its pose.
    """

    mj_model: mujoco.MjModel
    model: mjw.Model
    data: mjw.Data
    native: list[tuple[mujoco.MjModel, mujoco.MjData]]
    site: str
    camera: str


def primitive_worlds(nworld: int, device: str, seed: int) -> DepthWorlds:
    """A floor and 29 boxes, cylinders, capsules, spheres and ellipsoids before a camera that looks down."""
    rng = np.random.default_rng(seed)
    natives = [_primitives(rng) for _ in range(nworld)]
    return DepthWorlds(natives[0][0], *batch(natives, device), natives[:_NATIVE_WORLDS], "eye", "view")


def batch(natives: Sequence[tuple[mujoco.MjModel, mujoco.MjData]], device: str) -> tuple[mjw.Model, mjw.Data]:
    """Put worlds of static geoms, of the same types but of any pose and size, into one batch."""
    mj_model, fields = natives[0][0], ("geom_size", "geom_rbound", "geom_aabb")
    with wp.ScopedDevice(device):
        model = mjw.put_model(mj_model, batch_sizes=dict.fromkeys(fields, len(natives)))
        data = mjw.make_data(mj_model, nworld=len(natives))
        mjw.kinematics(model, data)
        mjw.camlight(model, data)
    for name in fields:
        _assign(getattr(model, name), [getattr(m, name) for m, _ in natives])
    _assign(data.geom_xpos, [d.geom_xpos for _, d in natives])
    _assign(data.geom_xmat, [d.geom_xmat for _, d in natives])
    return model, data


def corridor_worlds(env: NavEnv) -> DepthWorlds:
    """Hard corridors of the task with the robot at its start, its camera tilted down by 0.6 rad."""
    env.set_cells([0] * env.num_envs, [_HARD] * env.num_envs)
    env.reset()
    sim = env.sim
    sim.views.qpos[:, robot.DOF_NAMES.index("head_tilt")] = TILT
    with wp.ScopedDevice(sim.device):
        sim.forward()
        mjw.camlight(sim.model, sim.data)
    natives = []
    for world, qpos in enumerate(sim.data.qpos.numpy()[:_NATIVE_WORLDS]):
        m = native_model(sim.layout, world)
        d = mujoco.MjData(m)
        d.qpos[:] = qpos
        mujoco.mj_kinematics(m, d)
        natives.append((m, d))
    return DepthWorlds(sim.mj_model, sim.model, sim.data, natives, robot.CAMERA_SITE, "depth_camera")


def measure_depth(
    make_env: Callable[[int], NavEnv],
    counts: Sequence[int],
    device: str,
    seconds: float,
    seed: int,
    watch: Stopwatch,
) -> list[Row]:
    """Time frames of the portrait camera, 87 x 58 pixels.

    Args:
        make_env: Makes the environment that the corridors come from, given a number of worlds.
        counts: Numbers of worlds.
        device: Warp device of camera and renderer; C MuJoCo runs on one CPU core.
        seconds: Time to measure for, all of it together.
        seed: Seed of the primitives.
        watch: Waits for the device.

    Returns:
        Microseconds per frame of 30 primitives and of corridors, each beside three peers, and at the largest
        number of worlds, how they divide.
    """
    rows, share = [], seconds / (2 * len(counts))
    for count in counts:
        profile = count == max(counts)
        rows += _compare("30 primitives", primitive_worlds(count, device, seed), share, watch, profile)
        rows += _compare("corridor", corridor_worlds(make_env(count)), share, watch, profile)
    return rows


def operations(camera: DepthCamera) -> tuple[float, float]:
    """Pixels of all rectangles that a frame drew, and arithmetic operations; means over the worlds."""
    buffers = camera.buffers
    num_shown, shown, kind, rect = (
        getattr(buffers, name).numpy() for name in ("num_shown", "shown", "kind", "rect")
    )
    tests = flops = 0
    for world, count in enumerate(num_shown):
        for slot in shown[world, :count]:
            top, bottom, left, right = (int(edge) for edge in rect[world, slot])
            pixels, what = (bottom - top) * (right - left), int(kind[world, slot])
            tests += pixels
            flops += pixels * (2 * _LINES.get(what, _BOX_LINES) + _OTHER.get(what, _BOX_OTHER))
    return tests / len(num_shown), flops / len(num_shown)


def _compare(scene: str, worlds: DepthWorlds, seconds: float, watch: Stopwatch, profile: bool) -> list[Row]:
    nworld, device = worlds.data.geom_xpos.shape[0], str(worlds.data.geom_xpos.device)
    tan = robot.camera_tan_half_fov("portrait")
    site = worlds.mj_model.site(worlds.site).id
    camera = DepthCamera(
        worlds.mj_model,
        worlds.model,
        worlds.data,
        camera_site=site,
        tan_half_fov=tan,
        max_range=MAX_RANGE_M,
    )
    shape = camera.depth.shape[1:]
    camera.update()
    rays = NativeRays(worlds.native, worlds.site, tan, shape, MAX_RANGE_M)
    renderer = BatchRenderer(worlds.mj_model, worlds.model, worlds.data, worlds.camera, tan, shape)
    check_agreement(camera, rays.images(), MAX_RANGE_M, _RAYS)
    check_agreement(camera, renderer.images(), MAX_RANGE_M, _RENDER)

    def subject(launch: Callable[[], None], count: int = nworld) -> Subject:
        return Subject(lambda calls: watch.time(launch, calls), count)

    times = interleave(
        {
            "camera": subject(StepGraph(camera.update, device).replay),
            "rays": subject(rays.cast, len(worlds.native)),
            "refit": subject(renderer.refit_and_render),
            "render": subject(renderer.render),
            "project": subject(StepGraph(camera.project, device).replay),
            "draw": subject(StepGraph(camera.draw, device).replay),
        },
        seconds,
    )
    name = f"depth, {scene}, {nworld} world{'s' if nworld > 1 else ''}"
    peers = ((_RAYS, "rays"), (f"{_RENDER}, refit too", "refit"), (_RENDER, "render"))
    rows = [cost_row(name, times["camera"], _UNIT, peer, times[key]) for peer, key in peers]
    if profile:
        tests, flops = operations(camera)
        rows.append(cost_row(f"{name}: finding geoms and pixels", times["project"], _UNIT))
        drawing = f"drawing, {tests:,.0f} pixel tests, {flops:,.0f} operations"
        rows.append(cost_row(f"{name}: {drawing}", times["draw"], _UNIT))
    return rows


def _primitives(rng: np.random.Generator) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """One world of primitives, its camera 1.3 m up."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 0.05])
    for index in range(NUM_PRIMITIVES - 1):
        quat = rng.normal(size=4)
        spec.worldbody.add_geom(
            type=_SOLIDS[index % len(_SOLIDS)],
            pos=rng.uniform([0.6, -1.2, 0.0], [3.5, 1.2, 1.2]),
            quat=quat / np.linalg.norm(quat),
            size=rng.uniform(0.04, 0.2, 3),
        )
    sin, cos = np.sin(TILT), np.cos(TILT)
    eye = [0.0, 0.0, _CAMERA_HEIGHT_M]
    # Optical x points down in the image, y to the left; a camera's x to the right and its y up.
    spec.worldbody.add_site(name="eye", pos=eye, quat=_quat([sin, 0.0, -cos], [0.0, 1.0, 0.0]))
    spec.worldbody.add_camera(name="view", pos=eye, quat=_quat([0.0, -1.0, 0.0], [-sin, 0.0, cos]))
    m = spec.compile()
    d = mujoco.MjData(m)
    mujoco.mj_kinematics(m, d)
    return m, d


def _quat(x: list[float], y: list[float]) -> np.ndarray:
    """Rotation of a frame given by its x and y axes."""
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, np.stack([x, y, np.cross(x, y)], axis=1).ravel())
    return quat


def _assign(array: wp.array, values: list[np.ndarray]) -> None:
    array.assign(np.array(values, dtype=np.float32).reshape(array.numpy().shape))
