"""The scandot sensor: tokens of the obstacles in the local window, and of those that the camera sees."""

from __future__ import annotations

from typing import Protocol

import warp as wp

from spin_rl.sensors.interface import Sensor
from spin_rl.warp_kernels.scandots import scandot_tokens
from spin_rl.warp_kernels.slots import SlotArrays, slots_of
from spin_rl.warp_kernels.tokens import TOKEN_SIZE


class Obstacles(SlotArrays, Protocol):
    """The slots of all worlds; which are walls, shape (nslot,), and which nearby, shape (nworld, k)."""

    is_wall: wp.array
    nearby: wp.array


class Scandots(Sensor):
    """Owns the two token buffers and refreshes them with one kernel launch.

    Token i is that of slot `nearby[i]`. Tokens, their corner order, and what counts as seen are defined in
    ``spin_rl.warp_kernels.scandots`` and ``spin_rl.warp_kernels.tokens``.

    Attributes:
        all: Corners in the local window, whether seen or not, shape (nworld, k, 32), float.
        visible: Corners that the camera sees as well (the paper's mask F), shape (nworld, k, 32), float.
    """

    def __init__(
        self,
        obstacles: Obstacles,
        qpos: wp.array,
        site_xpos: wp.array,
        site_xmat: wp.array,
        *,
        camera_site: int,
        tan_half_fov: tuple[float, float],
        window: float = 2.0,
        near: float = 0.1,
        occlusion: bool = True,
        pieces_from: float | None = None,
    ) -> None:
        """Allocate the buffers and keep references to the arrays that ``update`` reads.

        Args:
            obstacles: Obstacle slots, shape (nworld, nslot), on the device of the sensor.
            qpos: ``d.qpos``, shape (nworld, nq); columns 0 to 2 are the base's x, y [m] and yaw [rad].
            site_xpos: ``d.site_xpos`` [m], shape (nworld, nsite), vec3.
            site_xmat: ``d.site_xmat``, shape (nworld, nsite), mat33.
            camera_site: Index of the camera's optical frame (x right, y down, z forward) among the sites.
            tan_half_fov: Tangent of half the field of view along the optical x and y axes.
            window: Half side of the square local window [m].
            near: Smallest depth that the camera sees [m].
            occlusion: Whether obstacles hide corners from the camera.
            pieces_from: Length or height of slots from which they are told by the piece that is seen, as
                walls are [m]; None tells of walls alone so.

        Raises:
            ValueError: A length or field of view is not positive, the site does not exist, or the arrays
                disagree on the number of worlds.
        """
        if min(tan_half_fov) <= 0.0 or window <= 0.0 or near <= 0.0:
            raise ValueError(
                f"tan_half_fov, window and near must be positive, got {tan_half_fov}, {window}, {near}"
            )
        if not 0 <= camera_site < site_xpos.shape[1]:
            raise ValueError(f"camera_site must be in [0, {site_xpos.shape[1]}), got {camera_site}")
        nworld = obstacles.pos.shape[0]
        if qpos.shape[0] != nworld or site_xpos.shape[0] != nworld or site_xmat.shape[0] != nworld:
            raise ValueError(
                f"obstacles have {nworld} worlds, but qpos {qpos.shape[0]}, site_xpos {site_xpos.shape[0]} "
                f"and site_xmat {site_xmat.shape[0]}"
            )
        self._obstacles = slots_of(obstacles)
        self._is_wall = obstacles.is_wall
        self._nearby = obstacles.nearby
        self._qpos = qpos
        self._site_xpos = site_xpos
        self._site_xmat = site_xmat
        self._camera_site = camera_site
        self._tan_half_fov = tan_half_fov
        self._window = window
        self._near = near
        self._occlusion = occlusion
        self._pieces_from = pieces_from or 0.0
        shape = (*obstacles.nearby.shape, TOKEN_SIZE)
        self.all = wp.zeros(shape, dtype=float, device=obstacles.pos.device)
        self.visible = wp.zeros(shape, dtype=float, device=obstacles.pos.device)

    def update(self) -> None:
        """Recompute both buffers from the current poses; graph-safe, and call it after the kinematics."""
        scandot_tokens(
            self._obstacles,
            self._is_wall,
            self._nearby,
            self._qpos,
            self._site_xpos,
            self._site_xmat,
            camera_site=self._camera_site,
            tan_half_fov=self._tan_half_fov,
            near=self._near,
            window=self._window,
            occlusion=self._occlusion,
            pieces_from=self._pieces_from,
            all_out=self.all,
            visible_out=self.visible,
        )
