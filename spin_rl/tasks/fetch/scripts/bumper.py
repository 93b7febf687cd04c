# pyright: reportGeneralTypeIssues=false
# (to a type checker, a Warp struct is an object, not a class)
"""Base speeds that keep the base away from everything, for a robot whose policy does not see walls."""

import warp as wp

from spin_rl.deploy.fetch.numbers import BUMPER_M, BUMPER_S
from spin_rl.scenes.footprint import NUM_BASE, pose_touches, vec8
from spin_rl.tasks.fetch.known import Known
from spin_rl.warp_kernels.slots import Slots

wp.set_module_options({"enable_backward": False})


@wp.func
def _touches(w: int, x: float, y: float, yaw: float, near: Slots) -> bool:
    """Whether the base at a pose comes nearer to anything than `BUMPER_M`."""
    return pose_touches(w, wp.vec3(x, y, yaw), vec8(), NUM_BASE, BUMPER_M, near)


@wp.func
def without_bumps(w: int, known: Known, forward: float, turn: float) -> wp.vec2:
    """Base speeds, those set to 0 that would take the base too near to anything."""
    base = known.base[w]
    x = base[0] + BUMPER_S * forward * wp.cos(base[2])
    y = base[1] + BUMPER_S * forward * wp.sin(base[2])
    if _touches(w, x, y, base[2], known.near):
        forward = 0.0
    if _touches(w, base[0], base[1], base[2] + BUMPER_S * turn, known.near):
        turn = 0.0
    return wp.vec2(forward, turn)
