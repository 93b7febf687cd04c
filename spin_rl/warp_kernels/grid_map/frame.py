# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportCallIssue=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false, reportArgumentType=false
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Where the cells of a grid are, and its values between them."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.struct
class Frame:
    """Cell (row, column) has its centre at ``origin`` + (column + 0.5, row + 0.5) * ``cell`` [m].

    ``origin`` has shape (nworld,); positions are in the frame of each world's map.
    """

    origin: wp.array[wp.vec2]
    cell: float


@wp.func
def cells_of(frame: Frame, world: int, point: wp.vec2) -> wp.vec2:
    """A point in units of cells: the integer part says in which it is."""
    return (point - frame.origin[world]) / frame.cell


@wp.func
def is_inside(at: wp.vec2, rows: int, columns: int) -> bool:
    """Whether cells of a grid are around a point in units of cells."""
    return at[0] >= 0.5 and at[1] >= 0.5 and at[0] < float(columns) - 0.5 and at[1] < float(rows) - 0.5


@wp.func
def value_at(values: wp.array3d[float], world: int, at: wp.vec2) -> float:
    """Value at a point in units of cells, interpolated between four centres; 0 outside of the grid."""
    if not is_inside(at, values.shape[1], values.shape[2]):
        return 0.0
    column = wp.min(int(at[0] - 0.5), values.shape[2] - 2)
    row = wp.min(int(at[1] - 0.5), values.shape[1] - 2)
    x = at[0] - 0.5 - float(column)
    y = at[1] - 0.5 - float(row)
    low = wp.lerp(values[world, row, column], values[world, row, column + 1], x)
    high = wp.lerp(values[world, row + 1, column], values[world, row + 1, column + 1], x)
    return wp.lerp(low, high, y)


@wp.func
def place(pose: wp.vec3, point: wp.vec2) -> wp.vec2:
    """Take a point from the frame of a pose (x, y, yaw) to the frame that the pose is in."""
    c = wp.cos(pose[2])
    s = wp.sin(pose[2])
    return wp.vec2(pose[0] + c * point[0] - s * point[1], pose[1] + s * point[0] + c * point[1])
