# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportCallIssue=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Where to drive next: the point of the shortest way that is some length ahead."""

import warp as wp

from spin_rl.warp_kernels.distance_field.field import UNREACHABLE, Field, field_at
from spin_rl.warp_kernels.distance_field.trace import step_down

_STRAIGHT = wp.constant(0.1)
"""A way is straight if it is longer than the straight line by no more than this [cells]."""

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _look_ahead(
    field: Field,
    qpos: wp.array2d[float],
    goal: wp.array[wp.vec2],
    length: float,
    # Out
    subgoal_out: wp.array[wp.vec2],
):
    world = wp.tid()
    at = wp.vec2(qpos[world, 0], qpos[world, 1])
    end = goal[world]
    value = field_at(field, world, at[0], at[1])
    if value >= UNREACHABLE:
        subgoal_out[world] = end
        return
    left = int(length / field.cell)
    while left > 0:
        left -= 1
        straight = wp.length(at - end)
        is_near = straight <= float(left) * field.cell and value <= straight + _STRAIGHT * field.cell
        if is_near or straight <= field.cell:
            at = end
            left = 0
        else:
            to = step_down(field, world, at, value)
            if wp.length(to - at) == 0.0:
                left = 0
            at = to
            value = field_at(field, world, at[0], at[1])
    subgoal_out[world] = at


def look_ahead(field: Field, qpos: wp.array, goal: wp.array, length: float, *, subgoal_out: wp.array) -> None:
    """Follow the worlds' fields for some length from where the bases are; graph-safe.

    Args:
        field: Solved fields.
        qpos: State of the robot, shape (nworld, nq); columns 0 and 1 are the base's x and y [m].
        goal: Where the ways end [m], shape (nworld,), vec2.
        length: Of the way that is followed [m].
        subgoal_out: Output, the points there [m], or the goals where they are nearer or no way is known,
            shape (nworld,), vec2.
    """
    wp.launch(
        _look_ahead,
        dim=goal.shape[0],
        inputs=[field, qpos, goal, length],
        outputs=[subgoal_out],
        device=goal.device,
    )
