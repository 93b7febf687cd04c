# pyright: reportGeneralTypeIssues=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""The shortest way itself: steepest descent in a distance field."""

import warp as wp

from spin_rl.warp_kernels.distance_field.field import UNREACHABLE, Field, cell_centre, field_at

_IN_SIGHT = wp.constant(2.0)
"""Distance to the goal from which a way is straight if the field says so [cells]."""

wp.set_module_options({"enable_backward": False})


@wp.func
def downhill(field: Field, world: int, at: wp.vec2) -> wp.vec2:
    """Direction of steepest descent."""
    reach = 0.5 * field.cell
    x = field_at(field, world, at[0] + reach, at[1]) - field_at(field, world, at[0] - reach, at[1])
    y = field_at(field, world, at[0], at[1] + reach) - field_at(field, world, at[0], at[1] - reach)
    return -wp.normalize(wp.vec2(x, y))


@wp.func
def _lowest_near(field: Field, world: int, at: wp.vec2) -> wp.vec2:
    """Centre of the lowest of the 9 cells around a point."""
    rows = field.values.shape[1]
    columns = field.values.shape[2]
    offset = (at - field.origin[world]) / field.cell
    middle_row = wp.clamp(int(offset[1]), 1, rows - 2)
    middle_column = wp.clamp(int(offset[0]), 1, columns - 2)
    best = cell_centre(field, world, middle_column, middle_row)
    lowest = float(UNREACHABLE)
    for row in range(middle_row - 1, middle_row + 2):
        for column in range(middle_column - 1, middle_column + 2):
            value = field.values[world, row, column]
            if value < lowest:
                lowest = value
                best = cell_centre(field, world, column, row)
    return best


@wp.func
def step_down(field: Field, world: int, at: wp.vec2, value: float) -> wp.vec2:
    """A point about a cell along the way from one with a value; the same where the field leads no further."""
    to = at + field.cell * downhill(field, world, at)
    lower = field_at(field, world, to[0], to[1])
    if lower > value - 0.5 * field.cell:  # over a ridge, or along a wall's cells
        to = _lowest_near(field, world, at)
        lower = field_at(field, world, to[0], to[1])
    return wp.where(lower < value, to, at)


@wp.kernel
def _trace(
    mask: wp.array[wp.bool],
    field: Field,
    start: wp.array[wp.vec3],
    # Out
    length_out: wp.array[float],
    points_out: wp.array2d[wp.vec2],
    count_out: wp.array[int],
):
    world = wp.tid()
    if not mask[world]:
        return
    goal = field.goal[world]
    at = wp.vec2(start[world][0], start[world][1])
    value = field_at(field, world, at[0], at[1])
    length = float(0.0)
    count = int(0)
    arrived = bool(False)
    steps = int(0)
    while value < UNREACHABLE and not arrived and steps < field.values.shape[1] * field.values.shape[2]:
        steps += 1
        if count < points_out.shape[1] - 1:
            points_out[world, count] = at
            count += 1
        straight = wp.length(at - goal)
        to = goal
        arrived = straight <= _IN_SIGHT * field.cell and value <= straight + 0.1 * field.cell
        if not arrived:
            to = step_down(field, world, at, value)
            value = field_at(field, world, to[0], to[1])
            if wp.length(to - at) == 0.0:
                to = goal
                arrived = True
        length += wp.length(to - at)
        at = to
    if arrived:
        points_out[world, count] = goal
        count += 1
    count_out[world] = count
    length_out[world] = wp.where(arrived, length, UNREACHABLE)


def trace_paths(
    field: Field,
    start: wp.array,
    mask: wp.array,
    *,
    length_out: wp.array,
    points_out: wp.array,
    count_out: wp.array,
) -> None:
    """Follow the masked worlds' fields from the starts to the goals; graph-safe.

    Args:
        field: Solved fields.
        start: Base poses (x [m], y [m], yaw [rad]), shape (nworld,), vec3.
        mask: Worlds to follow, shape (nworld,), bool.
        length_out: Output, lengths of the ways [m], shape (nworld,); `UNREACHABLE` where there is none.
        points_out: Output, the ways' points about a cell apart [m], shape (nworld, npoint), vec2; of longer
            ones the beginning and the goal.
        count_out: Output, how many points a way has, 0 where there is none, shape (nworld,), int32.
    """
    wp.launch(
        _trace,
        dim=mask.shape[0],
        inputs=[mask, field, start],
        outputs=[length_out, points_out, count_out],
        device=mask.device,
    )
