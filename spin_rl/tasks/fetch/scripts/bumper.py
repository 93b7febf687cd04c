# pyright: reportGeneralTypeIssues=false
# (to a type checker, a Warp struct is an object, not a class)
"""Base speeds that keep the base away from everything, for a robot whose policy does not see walls."""

import warp as wp

from spin_rl.scenes.footprint import NUM_BASE, pose_touches, vec8
from spin_rl.warp_kernels.slots import Slots

_BUMPER_M = wp.constant(0.03)
_BUMPER_S = wp.constant(0.4)
"""The base keeps so far from everything that it would come nearer to than this in this time."""
wp.set_module_options({"enable_backward": False})


@wp.func
def _touches(w: int, x: float, y: float, yaw: float, slots: Slots) -> bool:
    """Whether the base at a pose comes nearer to anything than `_BUMPER_M`."""
    return pose_touches(w, wp.vec3(x, y, yaw), vec8(), NUM_BASE, _BUMPER_M, slots)


@wp.func
def without_bumps(w: int, base: wp.vec3, forward: float, turn: float, slots: Slots) -> wp.vec2:
    """Base speeds, those set to 0 that would take the base too near to anything."""
    x = base[0] + _BUMPER_S * forward * wp.cos(base[2])
    y = base[1] + _BUMPER_S * forward * wp.sin(base[2])
    if _touches(w, x, y, base[2], slots):
        forward = 0.0
    if _touches(w, base[0], base[1], base[2] + _BUMPER_S * turn, slots):
        turn = 0.0
    return wp.vec2(forward, turn)
