# pyright: reportGeneralTypeIssues=false
# (to a type checker, a Warp struct is an object, not a class)
"""The maps of all worlds and the ways through them, in the host's memory."""

from __future__ import annotations

import math

import numpy as np
import warp as wp

from spin_rl.baselines.lidar_stack.settings import LocalizationSettings, MapSettings, PlannerSettings
from spin_rl.extras import require
from spin_rl.warp_kernels.distance_field.field import UNREACHABLE, Field
from spin_rl.warp_kernels.distance_field.solve import spread_values
from spin_rl.warp_kernels.distance_field.trace import trace_paths
from spin_rl.warp_kernels.grid_map.costs import find_news, prepare_ways
from spin_rl.warp_kernels.grid_map.frame import Frame
from spin_rl.warp_kernels.grid_map.scans import Evidence, add_scans, smear_hits

DEVICE = "cpu"
_RINGS = 3
"""Blocked cells beside passable ones that have values: a robot may have come too near to something."""
_SAME_M = 0.15
"""What is seen so near to the map's obstacles is one of them."""
_MOST_POINTS = 2000
"""Of a way: 100 m in cells of 5 cm."""


def on_host(values: np.ndarray, dtype: type) -> wp.array:
    """Copy numbers into a Warp array, the last axis into vectors where the type is one."""
    kind = np.int32 if dtype is wp.int32 else bool if dtype is wp.bool else np.float32
    return wp.array(np.ascontiguousarray(values, dtype=kind), dtype=dtype, device=DEVICE)


class Grids:
    """Occupancy grids as log-odds: above 0 a cell is occupied, at 0 unknown.

    Attributes:
        frame: Where the cells are, in the frame of the map.
        odds: The map, shape (nworld, ny, nx), as a Warp array.
        live: What was seen of late, likewise.
        near: How near a cell is to an obstacle, 0 to 1, for matching scans, likewise.
    """

    def __init__(self, nworld: int, cfg: MapSettings) -> None:
        """Allocate."""
        self._cfg = cfg
        side = math.ceil(cfg.side_m / cfg.cell_m)
        self.shape = (nworld, side, side)
        self.frame = Frame()
        self.frame.cell = cfg.cell_m
        with wp.ScopedDevice(DEVICE):
            self.frame.origin = wp.zeros(nworld, dtype=wp.vec2)
            self.odds, self.live, self.near = (wp.zeros(self.shape, dtype=float) for _ in range(3))
            self._news = wp.zeros(nworld, dtype=wp.int32)

    def restart(self, worlds: np.ndarray, goal: np.ndarray) -> None:
        """Empty the grids of some worlds, a mask, and put their middle halfway to the goals (n, 2) [m]."""
        self.frame.origin.numpy()[worlds] = (0.5 * goal - 0.5 * self._cfg.side_m)[worlds]
        for grid in (self.odds, self.live, self.near):
            grid.numpy()[worlds] = 0.0

    def forget_live(self, worlds: np.ndarray) -> None:
        """Forget what was seen of late in some worlds, a mask."""
        self.live.numpy()[worlds] = 0.0

    def add_to_map(self, worlds: np.ndarray, start: np.ndarray, ends: np.ndarray, kinds: np.ndarray) -> None:
        """Add scans to the maps of some worlds.

        Args:
            worlds: A mask, shape (n,).
            start: Where the beams start, in the map [m], shape (n, 2).
            ends: Where they end, shape (n, beams, 2).
            kinds: What they say, shape (n, beams).
        """
        cfg = self._cfg
        mask, points, what = (
            on_host(worlds, wp.bool),
            on_host(ends, wp.vec2),
            on_host(kinds, wp.int32),
        )
        evidence = _evidence(cfg.hit, cfg.passed, -cfg.limit, cfg.limit)
        add_scans(mask, self.frame, on_host(start, wp.vec2), points, what, evidence, odds_out=self.odds)
        smear_hits(mask, self.frame, points, what, sigma=cfg.match_sigma_m, near_out=self.near)

    def add_live(
        self, worlds: np.ndarray, start: np.ndarray, ends: np.ndarray, kinds: np.ndarray, cfg: PlannerSettings
    ) -> None:
        """Add scans to what was seen of late, see `add_to_map`."""
        add_scans(
            on_host(worlds, wp.bool),
            self.frame,
            on_host(start, wp.vec2),
            on_host(ends, wp.vec2),
            on_host(kinds, wp.int32),
            _evidence(cfg.hit, cfg.passed, *cfg.limits),
            odds_out=self.live,
        )

    def news(self, worlds: np.ndarray, cfg: LocalizationSettings) -> np.ndarray:
        """Numbers that change where what was seen of late and is not in the map does, shape (n,).

        Args:
            worlds: Those to look at, a mask, shape (n,).
            cfg: As for `finish_map`, which has been called.
        """
        known = float(_log_likelihood(np.array(_SAME_M), cfg))
        find_news(on_host(worlds, wp.bool), self.live, self.near, known=known, sum_out=self._news)
        return self._news.numpy().copy()

    def finish_map(self, worlds: np.ndarray, cfg: LocalizationSettings) -> None:
        """Let `near` tell how likely a beam ends in a cell, for localization.

        It is the logarithm of the likelihood, by the distance to the map's obstacles, over that far away
        from all of them.

        Args:
            worlds: A mask, shape (n,).
            cfg: How beams end.

        Raises:
            ConfigError: SciPy is not installed.
        """
        ndimage = require("scipy.ndimage", "SciPy", "planner", "policy")
        odds, near = self.odds.numpy(), self.near.numpy()
        for world in np.flatnonzero(worlds):
            near[world] = 0.0
            rows, columns = np.nonzero(odds[world] > 0.0)
            if len(rows) == 0:
                continue
            reach = math.ceil(4.0 * cfg.sigma_hit_m / self._cfg.cell_m)
            window = tuple(slice(max(at.min() - reach, 0), at.max() + reach + 1) for at in (rows, columns))
            distance = ndimage.distance_transform_edt(odds[world][window] <= 0.0) * self._cfg.cell_m
            near[world][window] = _log_likelihood(distance, cfg)


class Ways:
    """Ways left to the goal from all cells, with the repository's own solver of distance fields.

    Attributes:
        field: What `field_at` reads.
    """

    def __init__(self, grids: Grids, cfg: PlannerSettings) -> None:
        """Allocate for the grids."""
        self._grids, self._cfg = grids, cfg
        nworld, ny, nx = grids.shape
        self.field = Field()
        self.field.cell = grids.frame.cell
        self.field.origin = grids.frame.origin
        with wp.ScopedDevice(DEVICE):
            self.field.values = wp.full(grids.shape, UNREACHABLE, dtype=float)
            self.field.goal = wp.zeros(nworld, dtype=wp.vec2)
            self._kinds = wp.zeros(grids.shape, dtype=wp.int32)
            self._queue = wp.zeros((nworld, ny * nx), dtype=wp.int32)
            self._box = wp.zeros(nworld, dtype=wp.vec4i)
            self._everywhere = wp.zeros(0, dtype=wp.int32)
            self._length = wp.zeros(nworld, dtype=float)
            self._points = wp.zeros((nworld, _MOST_POINTS), dtype=wp.vec2)
            self._count = wp.zeros(nworld, dtype=wp.int32)

    def plan(self, worlds: np.ndarray, goal: np.ndarray) -> None:
        """Plan anew in some worlds, a mask, to goals in the map (n, 2) [m]."""
        mask = on_host(worlds, wp.bool)
        prepare_ways(
            mask,
            self._grids.odds,
            self._grids.live,
            on_host(goal, wp.vec2),
            blocked=self._cfg.blocked_m,
            near=self._cfg.near_m,
            tolerance=self._cfg.goal_m,
            field=self.field,
            kinds_out=self._kinds,
        )
        spread_values(
            mask,
            self.field,
            kinds=self._kinds,
            queue=self._queue,
            box=self._box,
            rings=_RINGS,
            near=self._everywhere,
            beyond=0.0,
        )

    def lookahead(self, worlds: np.ndarray, poses: np.ndarray, way_m: float) -> tuple[np.ndarray, np.ndarray]:
        """Follow the ways of some worlds for a piece.

        Args:
            worlds: A mask, shape (n,).
            poses: Where from, shape (n, 3).
            way_m: How far [m].

        Returns:
            Points so far along the ways, shape (n, 2), and the lengths of the ways [m], `UNREACHABLE` where
            there is none, shape (n,).
        """
        trace_paths(
            self.field,
            on_host(poses, wp.vec3),
            on_host(worlds, wp.bool),
            length_out=self._length,
            points_out=self._points,
            count_out=self._count,
        )
        last = np.maximum(self._count.numpy() - 1, 0)
        index = np.minimum(round(way_m / self.field.cell), last)
        points = self._points.numpy()[np.arange(len(poses)), index]
        return points.astype(np.float64), self._length.numpy().copy()


def _log_likelihood(distance: np.ndarray, cfg: LocalizationSettings) -> np.ndarray:
    """Of a beam that ends at a distance to the map's obstacles [m], over that far away from all."""
    return np.log1p(cfg.z_hit / cfg.z_rand * np.exp(-0.5 * (distance / cfg.sigma_hit_m) ** 2))


def _evidence(hit: float, passed: float, low: float, high: float) -> Evidence:
    evidence = Evidence()
    evidence.hit, evidence.passed, evidence.low, evidence.high = hit, passed, low, high
    return evidence
