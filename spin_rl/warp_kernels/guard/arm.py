# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportInvalidTypeForm=false
# pyright: reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportIndexIssue=false, reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Keeping the arm out of what was seen: it is to stand where it would soon move into a thing."""

import warp as wp

from spin_rl.warp_kernels.guard.hulls import FIRST_ARM_HULL, NUM_HULLS, half_of, hulls_of, middle_of
from spin_rl.warp_kernels.guard.trial import Things, gap_between, is_level, thing_of

_AHEAD_STEPS = wp.constant(3.0)
"""Boxes are expected to go on moving, relative to the base, for so many steps: two until the arm stands."""
_NEAR_M = wp.constant(0.01)
"""Distance that counts as a hit [m]."""
_DEEPER_M = wp.constant(0.002)
"""What overlaps already goes deeper when it does by so much [m]."""
_JUMP_M = wp.constant(0.15)
"""A corner that moved farther in a step belongs to another episode [m]."""

wp.set_module_options({"enable_backward": False, "max_unroll": 1})


@wp.kernel
def _keep_arm_off(
    hull_low: wp.array2d[wp.vec3],
    hull_high: wp.array2d[wp.vec3],
    things: Things,
    # In and out
    last_low: wp.array2d[wp.vec3],
    last_high: wp.array2d[wp.vec3],
    # Out
    stand_out: wp.array[wp.bool],
):
    world = wp.tid()
    now = hulls_of(world, hull_low, hull_high)
    soon = hulls_of(world, hull_low, hull_high)
    stand_out[world] = False
    for hull in range(FIRST_ARM_HULL, NUM_HULLS):
        low = hull_low[world, hull] - last_low[world, hull]
        high = hull_high[world, hull] - last_high[world, hull]
        last_low[world, hull] = hull_low[world, hull]
        last_high[world, hull] = hull_high[world, hull]
        if wp.max(wp.length(low), wp.length(high)) < _JUMP_M:
            for axis in range(3):
                soon.low[hull, axis] = now.low[hull, axis] + _AHEAD_STEPS * wp.min(low[axis], 0.0)
                soon.high[hull, axis] = now.high[hull, axis] + _AHEAD_STEPS * wp.max(high[axis], 0.0)
            for k in range(things.count[world]):
                if is_level(world, k, things, soon, hull):
                    allowed = float(_NEAR_M)
                    if is_level(world, k, things, now, hull):
                        allowed = wp.min(allowed, things.gap[world, k][hull] - _DEEPER_M)
                    thing = thing_of(world, k, things)
                    if gap_between(middle_of(soon, hull), half_of(soon, hull), thing) < allowed:
                        stand_out[world] = True


def keep_arm_off(
    hull_low: wp.array,
    hull_high: wp.array,
    things: Things,
    *,
    last_low: wp.array,
    last_high: wp.array,
    stand_out: wp.array,
) -> None:
    """Find the robots whose arms are about to move into what is remembered; graph-safe.

    Args:
        hull_low: Boxes around the robot, see `hulls.measure_hulls`.
        hull_high: Their highest corners.
        things: What is near, as the guard has gathered it.
        last_low: Boxes of the step before; become those of now.
        last_high: Their highest corners.
        stand_out: Output, whether the arm is to stand, shape (nworld,), bool.
    """
    wp.launch(
        _keep_arm_off,
        dim=stand_out.shape[0],
        inputs=[hull_low, hull_high, things, last_low, last_high],
        outputs=[stand_out],
        device=stand_out.device,
    )
