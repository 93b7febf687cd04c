"""Speed of the scandot kernel, beside the same computation in NumPy and C MuJoCo."""

from __future__ import annotations

import numpy as np
import warp as wp

from spin_rl import robot
from spin_rl.scenes.corridors.generator import generate_layouts
from spin_rl.scenes.layout import Layout, PoolSpec
from spin_rl.sensors.scandots import Scandots
from spin_rl.sim.graph import StepGraph
from spin_rl.speed.peers.scandots import HostWorlds, SightModel, scandot_tokens_numpy
from spin_rl.speed.rows import Row, cost_row
from spin_rl.speed.timing import Stopwatch, Subject, interleave
from spin_rl.tasks.nav.config import NavConfig

OBSTACLES = PoolSpec(num_walls=0, num_boxes=10, num_cylinders=4)
MIN_WORLDS = 256
SIGHT_WORLDS = 64  # models that C MuJoCo compiles one by one
_UNIT = "us/world"


class VisibilityWorlds:
    """Worlds with a camera each, at the places where robots stand."""

    def __init__(self, layout: Layout, base: np.ndarray, cfg: NavConfig, seed: int) -> None:
        """Draw camera directions.

        Args:
            layout: Scenes.
            base: Base x, y [m] and yaw [rad], shape (nworld, 3).
            cfg: Gives camera mount and window.
            seed: Seed of the directions: any pan, tilt from a steep look down to level.
        """
        rng = np.random.default_rng(seed)
        self.layout, self.base, self._cfg = layout, base.astype(np.float32), cfg
        self.cam_mat = camera_frames(
            base[:, 2] + rng.uniform(-np.pi, np.pi, len(base)),
            rng.uniform(-1.0, 0.0, len(base)),
            cfg.camera_mount,
        )
        self.cam_pos = np.column_stack([base[:, :2], rng.uniform(1.1, 1.35, len(base))]).astype(np.float32)
        self.tan_half_fov = robot.camera_tan_half_fov(cfg.camera_mount)

    def sensor(self, occlusion: bool) -> Scandots:
        """A scandot sensor of all worlds."""
        with wp.ScopedDevice(self.layout.device):
            return Scandots(
                self.layout,
                wp.array(self.base, dtype=float),
                wp.array(self.cam_pos[:, None], dtype=wp.vec3),
                wp.array(self.cam_mat[:, None], dtype=wp.mat33),
                camera_site=0,
                tan_half_fov=self.tan_half_fov,
                window=self._cfg.scandots.window_m,
                near=self._cfg.scandots.near_m,
                occlusion=occlusion,
            )

    def host(self, count: int) -> HostWorlds:
        """The first worlds as arrays for the peers."""
        pos, yaw, half = (getattr(self.layout, name).numpy()[:count] for name in ("pos", "yaw", "half_size"))
        scandots = self._cfg.scandots
        poses = (self.base[:count], self.cam_pos[:count], self.cam_mat[:count])
        return HostWorlds(pos, yaw, half, *poses, self.tan_half_fov, scandots.window_m, scandots.near_m)


def obstacle_worlds(nworld: int, cfg: NavConfig, device: str, seed: int) -> VisibilityWorlds:
    """Worlds with 14 boxes and cylinders around the robot, most of them in the local window."""
    rng = np.random.default_rng(seed)
    layout = Layout(nworld, OBSTACLES, device)
    shape = (nworld, OBSTACLES.num_slots)
    angle, radius = rng.uniform(-np.pi, np.pi, shape), rng.uniform(0.6, 2.5, shape)
    half = rng.uniform([0.05, 0.05, 0.05], [0.25, 0.25, 0.7], (*shape, 3))
    half[:, OBSTACLES.first_cylinder :, 1] = half[:, OBSTACLES.first_cylinder :, 0]
    centre = np.stack([radius * np.cos(angle), radius * np.sin(angle), half[..., 2]], -1)
    layout.pos.assign(centre.astype(np.float32))
    layout.yaw.assign(rng.uniform(-np.pi, np.pi, shape).astype(np.float32))
    layout.half_size.assign(half.astype(np.float32))
    layout.active.fill_(True)
    base = np.column_stack([np.zeros((nworld, 2)), rng.uniform(-np.pi, np.pi, nworld)])
    return VisibilityWorlds(layout, base, cfg, seed)


def corridor_worlds(nworld: int, cfg: NavConfig, device: str, seed: int) -> VisibilityWorlds:
    """Hard worlds of the nav task, walls included, with the robot at its start."""
    layout = Layout(nworld, PoolSpec(), device)
    with wp.ScopedDevice(device):
        generate_layouts(
            layout,
            cfg.scene,
            seed=wp.array([seed], dtype=wp.int32),
            counter=wp.zeros(nworld, dtype=wp.int32),
            mask=wp.full(nworld, True, dtype=bool),
            scenario_choice=wp.zeros(nworld, dtype=wp.int32),
            difficulty_choice=wp.full(nworld, 2, dtype=wp.int32),
            level=wp.full(nworld, 1.0, dtype=float),
        )
    return VisibilityWorlds(layout, layout.start.numpy(), cfg, seed)


def measure_visibility(
    cfg: NavConfig, nworld: int, device: str, seconds: float, seed: int, watch: Stopwatch
) -> list[Row]:
    """Time the kernel over many worlds.

    Args:
        cfg: Gives camera, window and scenes.
        nworld: Worlds of one launch; at least `MIN_WORLDS` are taken.
        device: Warp device of the kernel; the peers run on one CPU core.
        seconds: Time to measure for.
        seed: Seed of the worlds.
        watch: Waits for the device.

    Returns:
        Microseconds per world, of 14 obstacles without and with lines of sight, and of the task's own worlds.
    """
    nworld = max(nworld, MIN_WORLDS)
    obstacles = obstacle_worlds(nworld, cfg, device, seed)
    corridors = corridor_worlds(nworld, cfg, device, seed)

    def kernel(worlds: VisibilityWorlds, occlusion: bool) -> Subject:
        sensor = worlds.sensor(occlusion)
        sensor.update()  # compiles
        graph = StepGraph(sensor.update, device)
        return Subject(lambda calls: watch.time(graph.replay, calls), nworld)

    some = obstacles.host(SIGHT_WORLDS)
    sight = [SightModel(obstacles.layout, world) for world in range(SIGHT_WORLDS)]
    every = obstacles.host(nworld)
    times = interleave(
        {
            "mask": kernel(obstacles, occlusion=False),
            "numpy": Subject(lambda n: watch.time(lambda: scandot_tokens_numpy(every), n), nworld),
            "sight": kernel(obstacles, occlusion=True),
            "rays": Subject(lambda n: watch.time(lambda: scandot_tokens_numpy(some, sight), n), SIGHT_WORLDS),
            "corridor": kernel(corridors, occlusion=True),
        },
        seconds,
    )
    rays = "NumPy, sight by C MuJoCo mj_multiRay"
    return [
        cost_row("scandots, 14 obstacles, frustum and window", times["mask"], _UNIT, "NumPy", times["numpy"]),
        cost_row("scandots, 14 obstacles, line of sight too", times["sight"], _UNIT, rays, times["rays"]),
        cost_row("scandots, hard nav worlds with walls, line of sight too", times["corridor"], _UNIT),
    ]


def camera_frames(pan: np.ndarray, tilt: np.ndarray, mount: robot.CameraMount) -> np.ndarray:
    """Camera-to-world rotations (x image right, y image down, z forward) of level cameras that pan and tilt.

    Args:
        pan: Turn to the left [rad], shape (nworld,).
        tilt: Turn upwards [rad], shape (nworld,).
        mount: "portrait": the optical x axis points down in the world; or "landscape".

    Returns:
        Shape (nworld, 3, 3), float32.
    """
    forward = np.stack([np.cos(pan) * np.cos(tilt), np.sin(pan) * np.cos(tilt), np.sin(tilt)], -1)
    right = np.stack([np.sin(pan), -np.cos(pan), np.zeros_like(pan)], -1)
    down = np.cross(forward, right)
    x, y = (down, -right) if mount == "portrait" else (right, down)
    return np.stack([x, y, forward], -1).astype(np.float32)
