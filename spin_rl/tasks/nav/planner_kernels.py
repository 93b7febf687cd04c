# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportArgumentType=false
"""When to plan."""

import warp as wp

from spin_rl.warp_kernels.distance_field.field import UNREACHABLE, Field, field_at

wp.set_module_options({"enable_backward": False})


@wp.kernel
def begin_plans(
    mask: wp.array(dtype=bool),
    qpos: wp.array2d(dtype=float),
    goal: wp.array(dtype=wp.vec2),
    size: float,
    # Out
    field: Field,
    wait: wp.array(dtype=wp.int32),
) -> None:
    w = wp.tid()
    if mask[w]:
        wait[w] = 0
        middle = 0.5 * (wp.vec2(qpos[w, 0], qpos[w, 1]) + goal[w])
        field.origin[w] = middle - wp.vec2(0.5 * size, 0.5 * size)


@wp.kernel
def choose_worlds(
    every: int,
    qpos: wp.array2d(dtype=float),
    field: Field,
    goal: wp.array(dtype=wp.vec2),
    planned_goal: wp.array(dtype=wp.vec2),
    # In and out
    changed: wp.array(dtype=bool),
    wait: wp.array(dtype=wp.int32),
    mask_out: wp.array(dtype=bool),
    near_out: wp.array(dtype=wp.int32),
) -> None:
    w = wp.tid()
    is_new = wait[w] == 0
    wait[w] = wait[w] + 1
    lost = field_at(field, w, qpos[w, 0], qpos[w, 1]) >= UNREACHABLE
    plan = is_new or ((changed[w] or lost) and wait[w] > every) or wp.length(goal[w] - planned_goal[w]) > 0.0
    mask_out[w] = plan
    if plan:
        changed[w] = False
        wait[w] = 1
        rows = field.values.shape[1]
        columns = field.values.shape[2]
        at = (wp.vec2(qpos[w, 0], qpos[w, 1]) - field.origin[w]) / field.cell
        column = wp.clamp(int(at[0]), 1, columns - 2)
        row = wp.clamp(int(at[1]), 1, rows - 2)
        near_out[w] = row * columns + column
