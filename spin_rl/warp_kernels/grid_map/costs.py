# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportCallIssue=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false, reportArgumentType=false
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Occupancy grids inflated by the robot's size, and where ways through them end.

They become what `distance_field.solve.spread_values` spreads ways through: passable cells, cells near
obstacles, in which a way costs more, and blocked ones.
"""

import warp as wp

from spin_rl.warp_kernels.distance_field.cells import BLOCKED, BORDER, FREE, KIND, SLOW, SOLID
from spin_rl.warp_kernels.distance_field.field import UNREACHABLE, Field, cell_centre

_GOAL_CELLS = wp.constant(12)
"""How far from a goal inside of what is blocked a passable cell is looked for [cells]."""

_AROUND = wp.constant(10)
"""Unknown cells around all that is known that may be driven through."""

wp.set_module_options({"enable_backward": False})


@wp.func
def _is_occupied(odds: wp.array3d[float], live: wp.array3d[float], w: int, row: int, column: int) -> bool:
    return odds[w, row, column] > 0.0 or live[w, row, column] > 0.0


@wp.func
def _is_within(odds: wp.array3d[float], live: wp.array3d[float], w: int, row: int, column: int) -> bool:
    """Whether the four cells beside an occupied one are occupied: then it reaches no farther than they."""
    return (
        _is_occupied(odds, live, w, row - 1, column)
        and _is_occupied(odds, live, w, row + 1, column)
        and _is_occupied(odds, live, w, row, column - 1)
        and _is_occupied(odds, live, w, row, column + 1)
    )


@wp.kernel
def _inflate(
    mask: wp.array[wp.bool],
    odds: wp.array3d[float],
    live: wp.array3d[float],
    goal: wp.array[wp.vec2],
    blocked: float,
    near: float,
    # Out
    field: Field,
    kinds_out: wp.array3d[int],
):
    """What the cells are, one thread per world: unknown ones count as near to an obstacle.

    Those that lie beyond all that is known, and beyond the goal, are no part of the world.
    """
    w = wp.tid()
    if not mask[w]:
        return
    rows = odds.shape[1]
    columns = odds.shape[2]
    at = (goal[w] - field.origin[w]) / field.cell
    low = wp.vec2i(int(at[0]), int(at[1]))
    high = low
    for row in range(rows):
        for column in range(columns):
            field.values[w, row, column] = UNREACHABLE
            kinds_out[w, row, column] = int(BLOCKED) | BORDER
            if odds[w, row, column] != 0.0:
                low = wp.vec2i(wp.min(low[0], column), wp.min(low[1], row))
                high = wp.vec2i(wp.max(high[0], column), wp.max(high[1], row))
    low = wp.vec2i(wp.max(low[0] - _AROUND, 1), wp.max(low[1] - _AROUND, 1))
    high = wp.vec2i(wp.min(high[0] + _AROUND + 1, columns - 1), wp.min(high[1] + _AROUND + 1, rows - 1))
    for row in range(low[1], high[1]):
        for column in range(low[0], high[0]):
            kind = int(FREE)
            if odds[w, row, column] == 0.0 and live[w, row, column] == 0.0:
                kind = int(SLOW)
            kinds_out[w, row, column] = kind
    reach = int(near / field.cell)
    near_sq = int(near * near / (field.cell * field.cell))
    blocked_sq = int(blocked * blocked / (field.cell * field.cell))
    for row in range(low[1], high[1]):
        for column in range(low[0], high[0]):
            here = _is_occupied(odds, live, w, row, column)
            if here:
                kinds_out[w, row, column] = int(SOLID)
            if here and not _is_within(odds, live, w, row, column):
                for i in range(wp.max(row - reach, low[1]), wp.min(row + reach + 1, high[1])):
                    for j in range(wp.max(column - reach, low[0]), wp.min(column + reach + 1, high[0])):
                        away = (i - row) * (i - row) + (j - column) * (j - column)
                        if away <= near_sq:
                            kind = wp.where(away <= blocked_sq, int(BLOCKED), int(SLOW))
                            kinds_out[w, i, j] = wp.max(kinds_out[w, i, j], kind)


@wp.kernel
def _seed(
    mask: wp.array[wp.bool],
    goal: wp.array[wp.vec2],
    tolerance: float,
    kinds: wp.array3d[int],
    # Out
    field: Field,
):
    """Straight distances of the passable cells at the goal, or else of those nearest to it."""
    w = wp.tid()
    if not mask[w]:
        return
    field.goal[w] = goal[w]
    rows = kinds.shape[1]
    columns = kinds.shape[2]
    at = (goal[w] - field.origin[w]) / field.cell
    low = wp.vec2i(wp.max(int(at[0]) - _GOAL_CELLS, 1), wp.max(int(at[1]) - _GOAL_CELLS, 1))
    high = wp.vec2i(
        wp.min(int(at[0]) + _GOAL_CELLS + 1, columns - 1), wp.min(int(at[1]) + _GOAL_CELLS + 1, rows - 1)
    )
    nearest = float(UNREACHABLE)
    for row in range(low[1], high[1]):
        for column in range(low[0], high[0]):
            if (kinds[w, row, column] & KIND) <= SLOW:
                nearest = wp.min(nearest, wp.length(cell_centre(field, w, column, row) - goal[w]))
    reach = wp.max(tolerance, nearest + 0.5 * field.cell)
    for row in range(low[1], high[1]):
        for column in range(low[0], high[0]):
            away = wp.length(cell_centre(field, w, column, row) - goal[w])
            if (kinds[w, row, column] & KIND) <= SLOW and away <= reach:
                field.values[w, row, column] = away


@wp.kernel
def _find_news(
    mask: wp.array[wp.bool],
    live: wp.array3d[float],
    near: wp.array3d[float],
    known: float,
    sum_out: wp.array[int],
):
    w = wp.tid()
    if not mask[w]:
        return
    total = int(0)
    for row in range(live.shape[1]):
        for column in range(live.shape[2]):
            if live[w, row, column] > 0.0 and near[w, row, column] < known:
                total += row * live.shape[2] + column + 1
    sum_out[w] = total


def find_news(mask: wp.array, live: wp.array, near: wp.array, *, known: float, sum_out: wp.array) -> None:
    """Sum up the numbers of the cells in which something was seen of late that is not in the map.

    Args:
        mask: Worlds, shape (nworld,), bool.
        live: Log-odds of what was seen of late, shape (nworld, ny, nx).
        near: How near cells are to the map's obstacles, likewise.
        known: From which of that on what is seen is the map's.
        sum_out: Output; it changes where the cells do, shape (nworld,), int32.
    """
    wp.launch(
        _find_news, dim=mask.shape, inputs=[mask, live, near, known], outputs=[sum_out], device=mask.device
    )


def prepare_ways(
    mask: wp.array,
    odds: wp.array,
    live: wp.array,
    goal: wp.array,
    *,
    blocked: float,
    near: float,
    tolerance: float,
    field: Field,
    kinds_out: wp.array,
) -> None:
    """Inflate the maps of the masked worlds and put values at their goals.

    Args:
        mask: Worlds, shape (nworld,), bool.
        odds: Log-odds of the map: above 0 a cell is occupied, at 0 unknown, shape (nworld, ny, nx).
        live: Log-odds of what was seen of late, likewise.
        goal: Where ways end [m], shape (nworld,), vec2.
        blocked: Distance to occupied cells below which no way leads through [m].
        near: Distance below which a way costs more [m].
        tolerance: Distance at which the goal counts as reached [m].
        field: Output: its values and goals; where its cells are.
        kinds_out: Output, what the cells are, shape (nworld, ny, nx), int32.
    """
    wp.launch(
        _inflate,
        dim=mask.shape,
        inputs=[mask, odds, live, goal, blocked, near],
        outputs=[field, kinds_out],
        device=mask.device,
    )
    wp.launch(
        _seed,
        dim=mask.shape,
        inputs=[mask, goal, tolerance, kinds_out],
        outputs=[field],
        device=mask.device,
    )
