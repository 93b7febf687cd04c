# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportIndexIssue=false
# pyright: reportArgumentType=false, reportCallIssue=false, reportReturnType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Values of a distance field, spread from the goal.

Cells near the goal that see it have the exact straight distance, and the values spread from there through an
active list: cells below a threshold are relaxed in the order of a queue, the others wait until the threshold
passes them (Bak, McLaughlin and Renzi 2010). The result is that of fast marching up to `_TOLERANCE`; most
cells are relaxed once, and those that no way leads to cost nothing. Fast sweeping took 1.2 to 9 ms where this
takes 0.3 to 0.6 ms. Where the ways from around one cell are enough, `toward` has a tenth of the work.

A world is one thread in `_spread`, on CUDA too, where that is the slow part. A variant for CUDA would give
each world a block, whose threads relax the cells of the active list in parallel, with a barrier per band.
"""

import warp as wp

from spin_rl.warp_kernels.distance_field.cells import BLOCKED, KIND, prepare_cells
from spin_rl.warp_kernels.distance_field.field import UNREACHABLE, Field
from spin_rl.warp_kernels.distance_field.relax import QUEUED, REACHED, SLOWNESS, lower, upwind
from spin_rl.warp_kernels.distance_field.toward import spread_toward
from spin_rl.warp_kernels.slots import Slots

MAX_RINGS = 15
"""More would run into the other flags."""

_EXTENDED = wp.constant(64)
"""Flag of blocked cells that got a value, plus the ring."""

_TOLERANCE = wp.constant(1.0e-4)
"""Smallest change that spreads [m]."""

_BAND = wp.constant(3.0)
"""What the threshold grows by, in cells: less means more waiting, more means more relaxing in vain."""

_CUDA_LANES = 128

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _spread(
    mask: wp.array[wp.bool],
    columns: int,
    cell: float,
    values: wp.array2d[float],
    kinds: wp.array2d[int],
    queues: wp.array2d[int],
    box_out: wp.array[wp.vec4i],
):
    """Relax cells until nothing changes; the arrays have the cells of a world in one row."""
    world = wp.tid()
    if not mask[world]:
        return
    value = values[world]
    kind = kinds[world]
    queue = queues[world]
    size = queue.shape[0]
    box_out[world] = wp.vec4i(0, 0, 1 - columns, 1 - size // columns)
    head = int(0)
    count = int(0)
    for seed in range(size):
        if value[seed] < UNREACHABLE:
            queue[count] = seed
            kind[seed] = kind[seed] | QUEUED
            count += 1
    threshold = float(0.0)
    waiting = int(0)  # how many cells in a row have been put back
    lowest = float(UNREACHABLE)  # their smallest value
    while count > 0:
        here = queue[head]
        head = wp.where(head + 1 == size, 0, head + 1)
        mine = value[here]
        if mine > threshold:
            tail = head + count - 1
            queue[wp.where(tail >= size, tail - size, tail)] = here
            waiting += 1
            lowest = wp.min(lowest, mine)
            if waiting >= count:
                threshold = lowest + _BAND * cell
                waiting = 0
                lowest = UNREACHABLE
            continue
        waiting = 0
        lowest = UNREACHABLE
        count -= 1
        kind[here] = (kind[here] & KIND) | REACHED
        for side in range(4):
            step = wp.where(side < 2, 1, columns)
            beside = here + wp.where(side % 2 == 0, step, -step)
            if lower(beside, mine, columns, cell, _TOLERANCE, value, kind):
                tail = head + count
                queue[wp.where(tail >= size, tail - size, tail)] = beside
                count += 1


@wp.func
def _settled(cell: int, ring: int, value: wp.array[float], kind: wp.array[int]) -> float:
    """Value of a cell that was reached, or extended to in an earlier ring; `UNREACHABLE` for others."""
    flags = kind[cell]
    if (flags & REACHED) != 0 or (flags >= _EXTENDED and flags < _EXTENDED + ring):
        return value[cell]
    return UNREACHABLE


@wp.func
def _extends_to(
    cell: int, ring: int, columns: int, side: float, value: wp.array[float], kind: wp.array[int]
) -> bool:
    """Give a cell a value if it is blocked, has none and is beside a settled one; say whether it got one."""
    if kind[cell] != BLOCKED:  # or reached, or extended to
        return False
    a = wp.min(_settled(cell - 1, ring, value, kind), _settled(cell + 1, ring, value, kind))
    b = wp.min(_settled(cell - columns, ring, value, kind), _settled(cell + columns, ring, value, kind))
    if wp.min(a, b) >= UNREACHABLE:
        return False
    value[cell] = upwind(a, b, SLOWNESS * side)
    kind[cell] = _EXTENDED + ring
    return True


@wp.kernel
def _extend(
    mask: wp.array[wp.bool],
    columns: int,
    side: float,
    box: wp.array[wp.vec4i],
    rings: int,
    values: wp.array2d[float],
    kinds: wp.array2d[int],
    queues: wp.array2d[int],
):
    """Give blocked cells beside settled ones a value, ring by ring: the robot's own point may be there."""
    world = wp.tid()
    if not mask[world]:
        return
    value = values[world]
    kind = kinds[world]
    queue = queues[world]
    around = box[world]
    last_row = wp.min(-around[3], queue.shape[0] // columns - 2)
    last_column = wp.min(-around[2], columns - 2)
    count = int(0)
    for row in range(wp.max(around[1], 1), last_row + 1):
        for column in range(wp.max(around[0], 1), last_column + 1):
            if _extends_to(row * columns + column, 0, columns, side, value, kind):
                queue[count] = row * columns + column
                count += 1
    first = int(0)
    for ring in range(1, rings):
        last = count
        for i in range(first, last):
            for k in range(4):
                step = wp.where(k < 2, 1, columns)
                cell = queue[i] + wp.where(k % 2 == 0, step, -step)
                if _extends_to(cell, ring, columns, side, value, kind):
                    queue[count] = cell
                    count += 1
        first = last


def spread_values(
    mask: wp.array,
    field: Field,
    *,
    kinds: wp.array,
    queue: wp.array,
    box: wp.array,
    rings: int,
    near: wp.array,
    beyond: float,
) -> None:
    """Spread the values that some cells have to those that ways lead to; graph-safe.

    Args:
        mask: Worlds, shape (nworld,), bool.
        field: Its ``values`` are `UNREACHABLE` in all other cells.
        kinds: What each cell is, see ``cells``; changed, shape (nworld, ny, nx), int32.
        queue: Scratch, shape (nworld, ny * nx), int32.
        box: As for `solve_distance_field`.
        rings: Likewise.
        near: Likewise.
        beyond: Likewise.
    """
    columns = kinds.shape[2]
    flat = (field.values.reshape(queue.shape), kinds.reshape(queue.shape), queue)
    launch = {"dim": queue.shape[0], "device": mask.device}
    if near.shape[0] == 0:
        wp.launch(_spread, inputs=[mask, columns, field.cell, *flat], outputs=[box], **launch)
    else:
        spread_toward(
            mask, field, kinds=kinds, queue=queue, near=near, beyond=beyond, rings=rings, box_out=box
        )
    wp.launch(_extend, inputs=[mask, columns, field.cell, box, rings, *flat], **launch)


def solve_distance_field(
    obstacles: Slots,
    goal: wp.array,
    mask: wp.array,
    field: Field,
    *,
    kinds: wp.array,
    queue: wp.array,
    box: wp.array,
    ceiling: float,
    clearance: float,
    blocked: float,
    rings: int,
    near: wp.array,
    beyond: float,
) -> None:
    """Compute the fields of the masked worlds; graph-safe, the scalars are frozen by a capture.

    Args:
        obstacles: Obstacle slots, shape (nworld, nslot); inactive ones do not count.
        goal: Where ways end [m], shape (nworld,), vec2. If it is outside the grid or inside an obstacle, no
            cell reaches it.
        mask: Worlds to compute, shape (nworld,), bool; the others' fields stay.
        field: Its ``values`` and ``goal`` are written.
        kinds: Scratch, what each cell is, shape (nworld, ny, nx), int32.
        queue: Scratch, shape (nworld, ny * nx), int32.
        box: Cells outside of which all values are `UNREACHABLE`: least column and row, largest column and
            row, negative; the whole grid before the first call. Changed, shape (nworld,), vec4i.
        ceiling: Obstacles whose bottom is not below do not count [m].
        clearance: Nearer to obstacles a way costs 4 times its length [m].
        blocked: Nearer no way leads through [m]; at least half a cell, or ways lead through thin walls.
        rings: Cells from passable ones up to which the others get values, at most `MAX_RINGS`.
        near: A cell of each world, row by row; of the ways to the goal only those are needed that are longer
            than from there, with the straight line from there to their beginning, by no more than ``beyond``
            [m]. Shape (nworld,), int32, or (0,) to find all.
        beyond: See `near`.
    """
    lanes = _CUDA_LANES if wp.get_device(str(mask.device)).is_cuda else 1
    prepare_cells(
        obstacles,
        goal,
        mask,
        field,
        kinds=kinds,
        box=box,
        ceiling=ceiling,
        clearance=clearance,
        blocked=blocked,
        lanes=lanes,
    )
    spread_values(mask, field, kinds=kinds, queue=queue, box=box, rings=rings, near=near, beyond=beyond)
