# pyright: reportGeneralTypeIssues=false, reportArgumentType=false, reportIndexIssue=false
# pyright: reportCallIssue=false, reportOperatorIssue=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""One relaxation of a cell: the eikonal equation |grad T| = slowness with first-order upwind differences.

Sources: Rouy and Tourin 1992; Zhao 2005, eq. 2.3.
"""

import warp as wp

from spin_rl.warp_kernels.distance_field.cells import BORDER, KIND, SLOW

QUEUED = wp.constant(8)
"""Flag of cells that wait to be relaxed from."""

REACHED = wp.constant(16)
"""Flag of cells that were."""

SLOWNESS = wp.constant(4.0)
"""Of cells nearer to obstacles than ``clearance``."""

wp.set_module_options({"enable_backward": False})


@wp.func
def upwind(a: float, b: float, step: float) -> float:
    """Value of a cell whose lower neighbours along both axes have the values a and b."""
    difference = wp.abs(a - b)
    if difference >= step:
        return wp.min(a, b) + step
    return 0.5 * (a + b + wp.sqrt(2.0 * step * step - difference * difference))


@wp.func
def is_passable(flags: int) -> bool:
    """Whether ways lead through a cell."""
    return (flags & (KIND | BORDER)) <= SLOW


@wp.func
def lower(
    cell: int,
    mine: float,
    columns: int,
    side: float,
    tolerance: float,
    value: wp.array[float],
    kind: wp.array[int],
) -> bool:
    """Lower the value of a cell beside one with the value ``mine``; say whether it has to be queued for that.

    ``side`` is that of a cell [m]; changes below ``tolerance`` [m] do not count.
    """
    flags = kind[cell]
    if not is_passable(flags) or value[cell] <= mine:
        return False
    step = wp.where((flags & KIND) == SLOW, SLOWNESS * side, side)
    a = wp.min(value[cell - 1], value[cell + 1])
    b = wp.min(value[cell - columns], value[cell + columns])
    found = upwind(a, b, step)
    if found >= value[cell] - tolerance:
        return False
    value[cell] = found
    if (flags & QUEUED) != 0:
        return False
    kind[cell] = flags | QUEUED
    return True
