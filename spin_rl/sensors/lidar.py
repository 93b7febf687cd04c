# pyright: reportGeneralTypeIssues=false
# (to a type checker, a Warp struct is an object, not a class)
"""The RE1's lidar, an RPLidar A1 on its base: what it reports in every control step, and scans of a drive."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import mujoco
import numpy as np
import warp as wp

from spin_rl.config import Range
from spin_rl.sensors.interface import Sensor
from spin_rl.warp_kernels.lidar import Beam, Mount, cast_rays, count_steps, measure_ranges, restart_turns
from spin_rl.warp_kernels.slots import slots_of

if TYPE_CHECKING:
    from spin_rl.sim.simulation import Simulation

LASER_SITE = "laser"
_HIDING = ("mast",)
"""Geoms of the robot that stand in the plane of the rays; arm and hand are above it when stowed."""
_SURVEYS = 1 << 20
"""Added to the number of an episode for the noise of scans before it."""


@dataclass(frozen=True)
class LidarConfig:
    """An RPLidar A1M8, by its data sheet: 0.15 to 12 m, 360 rays, 5.5 turns a second.

    Attributes:
        enabled: Whether there is one; then ranges and odometry are observation groups.
        rays: Rays of a turn.
        near_m: Nearest range [m].
        far_m: Farthest range [m].
        rate_hz: Turns in a second.
        noise: Standard deviation of a range as a share of it: the data sheet says "below 1 %".
    """

    enabled: bool = False
    rays: Annotated[int, Range(8, 4096)] = 360
    near_m: Annotated[float, Range(0.0, 10.0)] = 0.15
    far_m: Annotated[float, Range(0.0, 100.0, above=True)] = 12.0
    rate_hz: Annotated[float, Range(0.0, 100.0, above=True)] = 5.5
    noise: Annotated[float, Range(0.0, 0.5)] = 0.005

    def __post_init__(self) -> None:
        """Reject ranges that leave nothing to measure."""
        if not self.near_m < self.far_m:
            raise ValueError(f"task.lidar.far_m must exceed near_m, got {self.far_m}")


class Lidar(Sensor):
    """Owns the ranges of all worlds.

    The mirror turns while the robot drives: a control step brings the rays that it passes in that time, at
    the pose at its end. Seen are the slots, not the robot but for the mast, which hides some rays.

    Attributes:
        ranges: Of the rays of `warp_kernels.lidar`, with noise [m]; 0 where nothing came back, -1 where the
            mirror has not been in the last step, shape (nworld, rays).
        angles: Directions of the rays in the base frame [rad], shape (rays,).
        hidden: Rays that never come back, shape (rays,), bool.
        position: Of the lidar in the base frame [m], shape (3,).
    """

    def __init__(self, sim: Simulation, cfg: LidarConfig, *, seed: wp.array, episode: wp.array) -> None:
        """Allocate the buffers.

        Args:
            sim: The simulation; its base poses and layout are read at every update.
            cfg: The lidar.
            seed: Seed of the noise, shape (1,), int32.
            episode: Number of every world's episode, shape (nworld,), int32.
        """
        self.config = cfg
        self._layout = sim.layout
        self._slots = slots_of(sim.layout)
        self._qpos = sim.data.qpos
        self._seed, self._episode = seed, episode
        self._swept = min(round(cfg.rays * cfg.rate_hz * sim.config.control_period), cfg.rays)
        self.angles = 2.0 * math.pi / cfg.rays * np.arange(cfg.rays)
        self.hidden = hidden_rays(sim.mj_model, self.angles)
        self.position = sim.mj_model.site(LASER_SITE).pos.copy()
        self._mount, self._beam = Mount(), Beam()
        self._mount.x, self._mount.y, self._mount.z = self.position
        self._beam.near, self._beam.far, self._beam.noise = cfg.near_m, cfg.far_m, cfg.noise
        with wp.ScopedDevice(sim.device):
            self._mount.hidden = wp.array(self.hidden, dtype=bool)
            self.ranges = wp.zeros((sim.nworld, cfg.rays), dtype=float)
            self._step = wp.zeros(sim.nworld, dtype=wp.int32)

    def begin(self, mask: wp.array) -> None:
        """Let the mirror of the masked worlds start anew."""
        restart_turns(mask, step_out=self._step)

    def update(self) -> None:
        """Measure from the current poses; graph-safe."""
        count_steps(step_out=self._step)
        cast_rays(
            self._slots,
            self._slots.active,
            self._qpos,
            self._mount,
            farthest=2.0 * self.config.far_m,
            ranges_out=self.ranges,
        )
        measure_ranges(
            self._seed,
            self._episode,
            self._step,
            self._mount,
            self._beam,
            swept=self._swept,
            ranges_out=self.ranges,
        )

    def survey(self) -> Survey:
        """Prepare scans of a drive before the episodes: what moves is not there then."""
        layout = self._layout
        still = layout.active.numpy() & (layout.motion_speed.numpy() == 0.0)
        return Survey(self, still, layout.start.numpy().astype(np.float64))

    def scan_static(self, active: np.ndarray, poses: np.ndarray, step: int) -> np.ndarray:
        """Measure whole turns from given poses, shape (nworld, rays); copies from and to the device.

        Args:
            active: Slots that are there, shape (nworld, nslot), bool.
            poses: Base x, y [m] and yaw [rad] in the world, shape (nworld, 3).
            step: Number of the scan, which the noise depends on.
        """
        device = self.ranges.device
        qpos = wp.array(poses, dtype=float, device=device)
        ranges = wp.empty_like(self.ranges)
        cast_rays(
            self._slots,
            wp.array(active, dtype=bool, device=device),
            qpos,
            self._mount,
            farthest=2.0 * self.config.far_m,
            ranges_out=ranges,
        )
        before = wp.array(self._episode.numpy() + _SURVEYS, dtype=wp.int32, device=device)
        steps = wp.full(len(poses), step, dtype=wp.int32, device=device)
        measure_ranges(
            self._seed,
            before,
            steps,
            self._mount,
            self._beam,
            swept=self.config.rays,
            ranges_out=ranges,
        )
        return ranges.numpy()


class Survey:
    """Scans from wherever a robot stands in the worlds as they are now, without what moves in them.

    Attributes:
        start: Base poses at which the episodes start (x [m], y [m], yaw [rad]), shape (nworld, 3).
    """

    def __init__(self, lidar: Lidar, active: np.ndarray, start: np.ndarray) -> None:
        """Take over the lidar, the slots that are there, shape (nworld, nslot), and `start`."""
        self._lidar, self._active = lidar, active
        self._scans = 0
        self.start = start

    def scan(self, moved: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Measure a whole turn, shape (nworld, rays) [m].

        Args:
            moved: Base poses in the frame of the start (x [m], y [m], yaw [rad]), shape (nworld, 3).
            worlds: Where to measure, a mask, shape (nworld,); the others are empty.
        """
        self._scans += 1
        x, y, yaw = self.start.T
        poses = np.stack(
            (
                x + np.cos(yaw) * moved[:, 0] - np.sin(yaw) * moved[:, 1],
                y + np.sin(yaw) * moved[:, 0] + np.cos(yaw) * moved[:, 1],
                yaw + moved[:, 2],
            ),
            axis=1,
        )
        return self._lidar.scan_static(self._active & worlds[:, None], poses, self._scans)


def hidden_rays(model: mujoco.MjModel, angles: np.ndarray) -> np.ndarray:
    """Which rays the robot's own parts hide, shape (rays,), bool.

    Args:
        model: Has the robot.
        angles: Directions of the rays in the base frame [rad], shape (rays,).
    """
    hidden = np.zeros(len(angles), dtype=bool)
    position = model.site(LASER_SITE).pos
    for name in _HIDING:
        geom = model.geom(name)
        across = geom.pos[:2] - position[:2]
        wide = math.asin(geom.size[0] / float(np.linalg.norm(across)))
        aside = np.angle(np.exp(1j * (angles - math.atan2(across[1], across[0]))))
        hidden |= np.abs(aside) <= wide
    return hidden
