# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportArgumentType=false
# pyright: reportCallIssue=false, reportIndexIssue=false, reportOperatorIssue=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Odometry of the base: where wheel encoders say that it is, with errors that grow with the way driven."""

import math
from dataclasses import dataclass
from typing import Annotated

import warp as wp

from spin_rl.config import Range
from spin_rl.sensors.interface import Sensor

UPDATE_M, UPDATE_RAD = 0.2, math.pi / 6.0
"""Motion between two updates of AMCL, by its defaults; its errors are those of so much motion."""

Share = Annotated[float, Range(0.0, 10.0)]

wp.set_module_options({"enable_backward": False})


@dataclass(frozen=True)
class OdometryConfig:
    """Errors of the odometry, as AMCL's model `diff` has them for one of its updates.

    A drive straight ahead by `UPDATE_M` ends with normal errors of ``way * UPDATE_M^2`` [m] along it and
    ``turn_by_way * UPDATE_M^2`` [rad] in the heading; a turn on the spot by `UPDATE_RAD` with ``turn *
    UPDATE_RAD^2`` [rad] and ``way_by_turn * UPDATE_RAD^2`` [m]. Those of longer motions add up as variances.
    AMCL's defaults are 0.2; nobody has published measurements of the RE1.

    Attributes:
        turn: Of the heading by turning (alpha 1).
        turn_by_way: Of the heading by driving (alpha 2).
        way: Of the way by driving (alpha 3).
        way_by_turn: Of the way by turning (alpha 4).
    """

    turn: Share = 0.2
    turn_by_way: Share = 0.2
    way: Share = 0.2
    way_by_turn: Share = 0.2

    def variances(self) -> tuple[float, float, float, float]:
        """Variance of heading and way by a radian [rad^2, m^2], then by a metre [rad^2, m^2] of motion."""
        by_turn = [(alpha * UPDATE_RAD**2) ** 2 / UPDATE_RAD for alpha in (self.turn, self.way_by_turn)]
        by_way = [(alpha * UPDATE_M**2) ** 2 / UPDATE_M for alpha in (self.turn_by_way, self.way)]
        return by_turn[0], by_turn[1], by_way[0], by_way[1]


@wp.kernel
def _restart(
    mask: wp.array[wp.bool],
    qpos: wp.array2d[float],
    place_out: wp.array[wp.vec3],
    pose_out: wp.array[wp.vec3],
    step_out: wp.array[int],
) -> None:
    w = wp.tid()
    if mask[w]:
        place_out[w] = wp.vec3(qpos[w, 0], qpos[w, 1], qpos[w, 2])
        pose_out[w] = wp.vec3(0.0, 0.0, 0.0)
        step_out[w] = 0


@wp.kernel
def _add_motion(
    seed: wp.array[int],
    episode: wp.array[int],
    qpos: wp.array2d[float],
    variances: wp.vec4,
    place_out: wp.array[wp.vec3],
    pose_out: wp.array[wp.vec3],
    step_out: wp.array[int],
) -> None:
    """Add what the base has moved since the last call, with errors, one thread per world."""
    w = wp.tid()
    step = step_out[w]
    step_out[w] = step + 1
    place = place_out[w]
    now = wp.vec3(qpos[w, 0], qpos[w, 1], qpos[w, 2])
    place_out[w] = now
    moved = now - place
    middle = place[2] + 0.5 * moved[2]
    ahead = wp.cos(middle) * moved[0] + wp.sin(middle) * moved[1]
    aside = wp.cos(middle) * moved[1] - wp.sin(middle) * moved[0]
    way = wp.abs(ahead)
    turned = wp.abs(moved[2])
    rng = wp.rand_init(seed[0] + 32452843, w * 1000003 + episode[w] * 10007 + step)
    turn_error = wp.sqrt(variances[0] * turned + variances[2] * way) * wp.randn(rng)
    way_error = wp.sqrt(variances[1] * turned + variances[3] * way) * wp.randn(rng)
    ahead = ahead + way_error
    pose = pose_out[w]
    heading = pose[2] + 0.5 * (moved[2] + turn_error)
    pose_out[w] = wp.vec3(
        pose[0] + wp.cos(heading) * ahead - wp.sin(heading) * aside,
        pose[1] + wp.sin(heading) * ahead + wp.cos(heading) * aside,
        pose[2] + moved[2] + turn_error,
    )


class Odometry(Sensor):
    """Owns the pose that every world's encoders tell.

    Attributes:
        pose: x, y [m] and yaw [rad], not wrapped, in the frame of the episode's start, shape (nworld,), vec3.
    """

    def __init__(self, qpos: wp.array, cfg: OdometryConfig, *, seed: wp.array, episode: wp.array) -> None:
        """Allocate.

        Args:
            qpos: Base x, y [m] and yaw [rad] in columns 0 to 2, shape (nworld, nq).
            cfg: Errors.
            seed: Seed of the errors, shape (1,), int32.
            episode: Number of every world's episode, shape (nworld,), int32.
        """
        nworld = qpos.shape[0]
        self._qpos, self._seed, self._episode = qpos, seed, episode
        self._variances = wp.vec4(*cfg.variances())
        with wp.ScopedDevice(qpos.device):
            self.pose = wp.zeros(nworld, dtype=wp.vec3)
            self._place = wp.zeros(nworld, dtype=wp.vec3)
            self._step = wp.zeros(nworld, dtype=wp.int32)

    def begin(self, mask: wp.array) -> None:
        """Start anew at the masked worlds' start poses."""
        wp.launch(
            _restart,
            dim=self.pose.shape,
            inputs=[mask, self._qpos],
            outputs=[self._place, self.pose, self._step],
            device=self.pose.device,
        )

    def update(self) -> None:
        """Add what the bases have moved since the last update; graph-safe."""
        wp.launch(
            _add_motion,
            dim=self.pose.shape,
            inputs=[self._seed, self._episode, self._qpos, self._variances],
            outputs=[self._place, self.pose, self._step],
            device=self.pose.device,
        )
