# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# (to a type checker, a Warp struct is an object, not a class)
"""A map in place of a camera: all obstacles in the window, seen or not, with the errors that maps have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import warp as wp

from spin_rl.config import Choice
from spin_rl.sensors.interface import Sensor
from spin_rl.warp_kernels.map_errors import NUM_ERRORS, MapKinds, perturb_tokens


@dataclass(frozen=True)
class MapErrors:
    """A kind of map: the entries of Miki et al. 2022, [m] but for the share; of normal noise.

    The paper defines eight entries, z0 to z7, and prints seven; the last one counts for both offsets here.
    Entries that the paper gives as a multiple of c, which rises from 0 to 1 in training, are in `rising`.

    Attributes:
        fixed: Of every point in every step, xy and z; of all points together in every step, xy and z; of
            outliers; their share; of all points together over an episode, xy and z.
        rising: What is added, times c.
    """

    fixed: tuple[float, ...]
    rising: tuple[float, ...] = (0.0,) * NUM_ERRORS


ERRORS = {
    "none": MapErrors((0.0,) * NUM_ERRORS),
    "nominal": MapErrors((0.004, 0.005, 0.01, 0.04, 0.03, 0.05, 0.1, 0.1)),
    "offset": MapErrors((0.004, 0.005, 0.01, 0, 0, 0.02, 0.1, 0.1), (0, 0, 0, 0.1, 0.1, 0, 0, 0)),
    "noisy": MapErrors((0.004, 0, 0, 0, 0, 0, 0.1, 0.1), (0, 0.1, 0.1, 0.3, 0.3, 0.3, 0, 0)),
    "small": MapErrors((0.004, 0.005, 0.04, 0.04, 0.04, 0.01, 0.1, 0.1)),
    "large": MapErrors((0.004, 0.3, 0.2, 0.1, 0.1, 0.03, 0.1, 0.1)),
}
"""Kinds of maps by name: an exact one, the three that Miki et al. train with, and the two of their tests."""
MIXTURE = {"nominal": 0.6, "offset": 0.3, "noisy": 0.1}
"""Shares of the kinds, drawn at the start and in the middle of every episode (Miki et al. 2022)."""

MapName = Annotated[str, Choice(("mixture", *ERRORS))]


@dataclass(frozen=True)
class MapConfig:
    """The observation group `scandots_map`.

    Attributes:
        enabled: Whether there is one.
        errors: "mixture", or one of `ERRORS` throughout.
    """

    enabled: bool = False
    errors: MapName = "mixture"


class NoisyMap(Sensor):
    """Tokens as they are read from a map.

    Attributes:
        tokens: Those of `scandots` with errors, shape (nworld, k, 32), float.
    """

    def __init__(
        self,
        scandots: wp.array,
        errors: str,
        *,
        seed: wp.array,
        episode: wp.array,
        step: wp.array,
        level: wp.array,
        way: wp.array,
        way_left: wp.array,
        qpos: wp.array,
    ) -> None:
        """Allocate the buffer and keep references to the arrays that `update` reads.

        Args:
            scandots: Exact tokens, shape (nworld, k, 32), measured before.
            errors: See `MapConfig`.
            seed: Random seed, shape (1,), int32.
            episode: Number of the running episode, shape (nworld,), int32.
            step: Control steps of it, likewise.
            level: Training level of the worlds, 0 to 1, c of `MapErrors`, shape (nworld,), float.
            way: Way to the goal at the start of the episode [m], likewise.
            way_left: What is left of it [m], likewise.
            qpos: ``d.qpos``, shape (nworld, nq); column 2 is the base's yaw [rad].
        """
        shares = MIXTURE if errors == "mixture" else {errors: 1.0}
        self.tokens = wp.zeros_like(scandots)
        self._inputs = [
            scandots,
            _make_kinds(shares, scandots.device),
            seed,
            episode,
            step,
            level,
            way,
            way_left,
            qpos,
        ]

    def update(self) -> None:
        """Read the map where the robot is now; graph-safe, and call it after the scandots' update."""
        wp.launch(
            perturb_tokens,
            dim=self.tokens.shape[:2],
            inputs=self._inputs,
            outputs=[self.tokens],
            device=self.tokens.device,
        )


def _make_kinds(shares: dict[str, float], device: Any) -> Any:
    kinds = MapKinds()
    chosen = [ERRORS[name] for name in shares]
    with wp.ScopedDevice(device):
        kinds.up_to = wp.array(np.cumsum(list(shares.values())), dtype=float)
        kinds.fixed = wp.array([errors.fixed for errors in chosen], dtype=float)
        kinds.rising = wp.array([errors.rising for errors in chosen], dtype=float)
    return kinds
