# pyright: reportGeneralTypeIssues=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Distance fields as kernels read them."""

import warp as wp

UNREACHABLE = wp.constant(1.0e4)
"""Value of cells from which no way leads to the goal [m]."""

wp.set_module_options({"enable_backward": False})


@wp.struct
class Field:
    """Distance fields of all worlds.

    ``values`` [m] has shape (nworld, ny, nx). Cell (row, column) has its centre at ``origin`` + (column +
    0.5, row + 0.5) * ``cell`` [m]; ``origin`` and ``goal`` (nworld,) are in the world. The outermost cells
    are a frame without values.
    """

    values: wp.array3d[float]
    origin: wp.array[wp.vec2]
    goal: wp.array[wp.vec2]
    cell: float


@wp.func
def cell_centre(field: Field, world: int, column: int, row: int) -> wp.vec2:
    """Centre of a cell in the world [m]."""
    return field.origin[world] + field.cell * wp.vec2(float(column) + 0.5, float(row) + 0.5)


@wp.func
def field_at(field: Field, world: int, x: float, y: float) -> float:
    """Length of the way from a point to the goal [m]; `UNREACHABLE` plus the straight line if there is none.

    Interpolated is what the way is longer than the straight line, so that the value is exact where the goal
    is in sight and near. Cells that cannot reach the goal do not count beside others that can. Outside the
    grid's frame: the value beside it, plus the distance to there.
    """
    rows = field.values.shape[1]
    columns = field.values.shape[2]
    goal = field.goal[world]
    first = cell_centre(field, world, 1, 1)
    last = cell_centre(field, world, columns - 2, rows - 2)
    inside = wp.vec2(wp.clamp(x, first[0], last[0]), wp.clamp(y, first[1], last[1]))
    offset = (inside - first) / field.cell
    column = 1 + wp.clamp(int(offset[0]), 0, columns - 4)
    row = 1 + wp.clamp(int(offset[1]), 0, rows - 4)
    across = offset[0] - float(column - 1)
    up = offset[1] - float(row - 1)
    detour = float(0.0)
    weights = float(0.0)
    for corner in range(4):
        i = corner % 2
        j = corner // 2
        value = field.values[world, row + j, column + i]
        if value < UNREACHABLE:
            weight = wp.where(i == 0, 1.0 - across, across) * wp.where(j == 0, 1.0 - up, up)
            straight = wp.length(cell_centre(field, world, column + i, row + j) - goal)
            detour += weight * (value - straight)
            weights += weight
    distance = wp.length(wp.vec2(x, y) - goal)
    if weights <= 1.0e-6:
        return UNREACHABLE + distance
    return distance + detour / weights
