# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportIndexIssue=false
# pyright: reportArgumentType=false, reportCallIssue=false, reportOperatorIssue=false
# pyright: reportReturnType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Values of a distance field where the ways from around one cell lead, and not far beyond.

Cells are relaxed in the order of A* (Hart, Nilsson and Raphael 1968): by their value and the straight line
from there to the cell, a band at a time. What is known in the end is an ellipse around goal and cell, wider
where the way has to go around things: a tenth of the 15 x 15 m of a planner.
"""

import warp as wp

from spin_rl.warp_kernels.distance_field.cells import KIND, NEAR
from spin_rl.warp_kernels.distance_field.field import UNREACHABLE, Field
from spin_rl.warp_kernels.distance_field.relax import QUEUED, REACHED, is_passable, lower

_TOLERANCE = wp.constant(1.0e-3)
"""Smallest change that spreads [m]."""

_BAND = wp.constant(12.0)
"""What the threshold grows by, in cells: less means more looking at what waits, more means more cells."""

_FAR = wp.constant(1.0e9)

wp.set_module_options({"enable_backward": False})


@wp.func
def _value_near(cell: int, columns: int, value: wp.array[float], kind: wp.array[int]) -> float:
    """Value of a cell; of one that is not passable the largest of the passable ones around it."""
    if is_passable(kind[cell]):
        return value[cell]
    largest = float(-1.0)
    for i in range(9):
        beside = cell + (i // 3 - 1) * columns + i % 3 - 1
        if is_passable(kind[beside]):
            largest = wp.max(largest, value[beside])
    return wp.where(largest < 0.0, UNREACHABLE, largest)


@wp.func
def _key(value: float, at: wp.vec2i, to: wp.vec2i, side: float) -> float:
    """Length of a way from one place to the goal through another [m], the first part straight."""
    across = float(at[0] - to[0])
    up = float(at[1] - to[1])
    return value + side * wp.sqrt(across * across + up * up)


@wp.func
def _place(cell: int, columns: int) -> wp.vec2i:
    """Column and row of a cell."""
    return wp.vec2i(cell % columns, cell // columns)


@wp.func
def _around(at: wp.vec2i, box: wp.vec4i) -> wp.vec4i:
    """A box of cells that holds another one too: least column and row, largest column and row, negative."""
    return wp.min(box, wp.vec4i(at[0], at[1], -at[0], -at[1]))


@wp.func
def _next_band(
    late: int,
    columns: int,
    to: wp.vec2i,
    side: float,
    beyond: float,
    value: wp.array[float],
    kind: wp.array[int],
    queue: wp.array[int],
):
    """Move the waiting cells to the beginning of the queue that the next threshold lets pass.

    Returns:
        Threshold, how many were moved, how many wait on: none of either if all is known that is asked for.
    """
    size = queue.shape[0]
    lowest = float(_FAR)
    for i in range(late):
        cell = queue[size - 1 - i]
        lowest = wp.min(lowest, _key(value[cell], _place(cell, columns), to, side))
    enough = _value_near(to[1] * columns + to[0], columns, value, kind) + beyond
    threshold = wp.min(lowest + _BAND * side, enough)
    moved = int(0)
    kept = int(0)
    if enough >= lowest:
        for i in range(late):
            cell = queue[size - 1 - i]
            if _key(value[cell], _place(cell, columns), to, side) <= threshold:
                queue[moved] = cell
                moved += 1
            else:
                kept += 1
                queue[size - kept] = cell
    return threshold, moved, kept


@wp.kernel
def _spread_toward(
    mask: wp.array[wp.bool],
    field: Field,
    near: wp.array[int],
    beyond: float,
    rings: int,
    values: wp.array2d[float],
    kinds: wp.array2d[int],
    queues: wp.array2d[int],
    box_out: wp.array[wp.vec4i],
):
    """Relax cells until enough is known; the arrays have the cells of a world in one row.

    A queue begins with the cells below the threshold, from ``head`` to ``tail``, and ends with those that
    wait for it to grow, ``late`` of them.
    """
    world = wp.tid()
    if not mask[world]:
        return
    rows = field.values.shape[1]
    columns = field.values.shape[2]
    value = values[world]
    kind = kinds[world]
    queue = queues[world]
    size = queue.shape[0]
    to = _place(near[world], columns)
    box = wp.vec4i(to[0], to[1], -to[0], -to[1])
    late = int(0)
    goal = (field.goal[world] - field.origin[world]) / field.cell
    for row in range(wp.max(int(goal[1]) - NEAR, 1), wp.min(int(goal[1]) + NEAR, rows - 2) + 1):
        for column in range(wp.max(int(goal[0]) - NEAR, 1), wp.min(int(goal[0]) + NEAR, columns - 2) + 1):
            seed = row * columns + column
            if value[seed] < UNREACHABLE:
                late += 1
                queue[size - late] = seed
                kind[seed] = kind[seed] | QUEUED
                box = _around(wp.vec2i(column, row), box)
    threshold = float(0.0)
    head = int(0)
    tail = int(0)
    while head < tail or late > 0:
        if head == tail:
            head = int(0)
            threshold, tail, late = _next_band(late, columns, to, field.cell, beyond, value, kind, queue)
        else:
            here = queue[head]
            head += 1
            kind[here] = (kind[here] & KIND) | REACHED
            mine = value[here]
            for i in range(4):
                step = wp.where(i < 2, 1, columns)
                cell = here + wp.where(i % 2 == 0, step, -step)
                if lower(cell, mine, columns, field.cell, _TOLERANCE, value, kind):
                    if tail + late == size:  # there is room at the beginning
                        tail -= head
                        for k in range(tail):
                            queue[k] = queue[head + k]
                        head = int(0)
                    at = _place(cell, columns)
                    box = _around(at, box)
                    if _key(value[cell], at, to, field.cell) <= threshold:
                        queue[tail] = cell
                        tail += 1
                    else:
                        late += 1
                        queue[size - late] = cell
    grown = box - wp.vec4i(rings, rings, rings, rings)
    box_out[world] = wp.max(grown, wp.vec4i(0, 0, 1 - columns, 1 - rows))


def spread_toward(
    mask: wp.array,
    field: Field,
    *,
    kinds: wp.array,
    queue: wp.array,
    near: wp.array,
    beyond: float,
    rings: int,
    box_out: wp.array,
) -> None:
    """Spread the values that the cells around the goals have; graph-safe.

    Args:
        mask: Worlds, shape (nworld,), bool.
        field: Its ``values`` are `UNREACHABLE` in all other cells.
        kinds: What each cell is, see ``cells``; changed, shape (nworld, ny, nx), int32.
        queue: Scratch, shape (nworld, ny * nx), int32.
        near: A cell of each world, row by row, shape (nworld,), int32.
        beyond: Ways from cells are known where they and the straight line from `near` to the cell are longer
            than the way from `near` by no more than this [m].
        rings: By how many cells `box_out` is larger than what has values.
        box_out: Output, least column and row, largest column and row, negative, shape (nworld,), vec4i.
    """
    wp.launch(
        _spread_toward,
        dim=queue.shape[0],
        inputs=[
            mask,
            field,
            near,
            beyond,
            rings,
            field.values.reshape(queue.shape),
            kinds.reshape(queue.shape),
            queue,
        ],
        outputs=[box_out],
        device=mask.device,
    )
