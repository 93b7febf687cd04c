# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportCallIssue=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Where to drive next: the point of the shortest way that is some length ahead."""

import warp as wp

from spin_rl.warp_kernels.distance_field.field import UNREACHABLE, Field, field_at
from spin_rl.warp_kernels.distance_field.trace import downhill, lowest_near

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _look_ahead(
    field: Field, qpos: wp.array2d[float], goal: wp.array[wp.vec2], length: float, subgoal_out: wp.array[wp.vec2]
):
    world = wp.tid()
    at = wp.vec2(qpos[world, 0], qpos[world, 1])
    value = field_at(field, world, at[0], at[1])
    end = goal[world]
    if value >= UNREACHABLE:
        subgoal_out[world] = end
        return
    steps = int(length / field.cell)
    step = int(0)
    while step < steps:
        step += 1
        straight = wp.length(at - end)
        if straight <= field.cell or (
            straight <= float(steps - step) * field.cell and value <= straight + 0.1 * field.cell
        ):
            at = end
            step = steps
        else:
            to = at + field.cell * downhill(field, world, at)
            lower = field_at(field, world, to[0], to[1])
            if lower > value - 0.5 * field.cell:
                to = lowest_near(field, world, at)
                lower = field_at(field, world, to[0], to[1])
            if lower >= value:
                step = steps
            else:
                at = to
                value = lower
    subgoal_out[world] = at


def look_ahead(field: Field, qpos: wp.array, goal: wp.array, length: float, *, subgoal_out: wp.array) -> None:
    """Follow the worlds' fields for some length from where the bases are; graph-safe.

    Args:
        field: Solved fields.
        qpos: State of the robot, shape (nworld, nq).
        goal: Where the ways end [m], shape (nworld,), vec2.
        length: Of the way that is followed [m].
        subgoal_out: Output, the points there, or the goals where they are nearer or no way is known [m], shape
            (nworld,), vec2.
    """
    wp.launch(
        _look_ahead,
        dim=goal.shape[0],
        inputs=[field, qpos, goal, length],
        outputs=[subgoal_out],
        device=goal.device,
    )
