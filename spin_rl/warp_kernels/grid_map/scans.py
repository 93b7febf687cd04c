# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportCallIssue=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false, reportArgumentType=false
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Scans into occupancy grids, as log-odds (Moravec and Elfes 1985; Thrun, Burgard and Fox 2005, chapter 9).

A world is one thread, so that a cell is never written twice at a time; stacks that use this run on the host.
"""

import warp as wp

from spin_rl.warp_kernels.grid_map.frame import Frame, cells_of, is_inside

SKIPPED, HIT, PASSED = (wp.constant(i) for i in range(3))
"""A beam that says nothing, one that ends at an obstacle, and one that met none as far as it goes."""

_SMEAR = wp.constant(2)
"""Cells around a hit that tell that one is near."""

wp.set_module_options({"enable_backward": False})


@wp.struct
class Evidence:
    """Log-odds that a beam adds where it ends and where it passes, and their limits."""

    hit: float
    passed: float
    low: float
    high: float


@wp.kernel
def _add_scans(
    mask: wp.array[wp.bool],
    frame: Frame,
    start: wp.array[wp.vec2],
    ends: wp.array2d[wp.vec2],
    kinds: wp.array2d[int],
    evidence: Evidence,
    odds_out: wp.array3d[float],
):
    world = wp.tid()
    if not mask[world]:
        return
    rows = odds_out.shape[1]
    columns = odds_out.shape[2]
    begin = cells_of(frame, world, start[world])
    for beam in range(ends.shape[1]):
        kind = kinds[world, beam]
        if kind != SKIPPED:
            end = cells_of(frame, world, ends[world, beam])
            offset = end - begin
            # One cell a step along the axis that changes most.
            steps = int(wp.max(wp.abs(offset[0]), wp.abs(offset[1])))
            for step in range(steps):
                at = begin + offset * (float(step) / float(steps))
                if is_inside(at, rows, columns):
                    odds = odds_out[world, int(at[1]), int(at[0])] + evidence.passed
                    odds_out[world, int(at[1]), int(at[0])] = wp.max(odds, evidence.low)
    # What one beam hits another may graze: hits count at last.
    for beam in range(ends.shape[1]):
        if kinds[world, beam] == HIT:
            end = cells_of(frame, world, ends[world, beam])
            if is_inside(end, rows, columns):
                odds = odds_out[world, int(end[1]), int(end[0])] + evidence.hit
                odds_out[world, int(end[1]), int(end[0])] = wp.min(odds, evidence.high)


@wp.kernel
def _smear_hits(
    mask: wp.array[wp.bool],
    frame: Frame,
    ends: wp.array2d[wp.vec2],
    kinds: wp.array2d[int],
    sigma: float,
    near_out: wp.array3d[float],
):
    world = wp.tid()
    if not mask[world]:
        return
    rows = near_out.shape[1]
    columns = near_out.shape[2]
    scale = frame.cell * frame.cell / (2.0 * sigma * sigma)
    for beam in range(ends.shape[1]):
        if kinds[world, beam] == HIT:
            end = cells_of(frame, world, ends[world, beam])
            for row in range(wp.max(int(end[1]) - _SMEAR, 0), wp.min(int(end[1]) + _SMEAR + 1, rows)):
                for column in range(
                    wp.max(int(end[0]) - _SMEAR, 0), wp.min(int(end[0]) + _SMEAR + 1, columns)
                ):
                    away = wp.length_sq(wp.vec2(float(column) + 0.5, float(row) + 0.5) - end)
                    near = wp.exp(-scale * away)
                    near_out[world, row, column] = wp.max(near_out[world, row, column], near)


def add_scans(
    mask: wp.array,
    frame: Frame,
    start: wp.array,
    ends: wp.array,
    kinds: wp.array,
    evidence: Evidence,
    *,
    odds_out: wp.array,
) -> None:
    """Add a scan of each of the masked worlds to its log-odds.

    Args:
        mask: Worlds, shape (nworld,), bool.
        frame: Where the cells are.
        start: Where the beams start [m], shape (nworld,), vec2.
        ends: Where they end [m], shape (nworld, beams), vec2.
        kinds: `SKIPPED`, `HIT` or `PASSED`, shape (nworld, beams), int32.
        evidence: What is added.
        odds_out: Log-odds, shape (nworld, ny, nx); updated in place.
    """
    wp.launch(
        _add_scans,
        dim=mask.shape,
        inputs=[mask, frame, start, ends, kinds, evidence],
        outputs=[odds_out],
        device=mask.device,
    )


def smear_hits(
    mask: wp.array, frame: Frame, ends: wp.array, kinds: wp.array, *, sigma: float, near_out: wp.array
) -> None:
    """Raise the cells within 2 of a hit to exp(-d^2 / (2 sigma^2)), for matching later scans.

    Args:
        mask: Worlds, shape (nworld,), bool.
        frame: Where the cells are.
        ends: As for `add_scans`.
        kinds: As for `add_scans`.
        sigma: Of the distance d to the hit [m].
        near_out: Shape (nworld, ny, nx); updated in place.
    """
    wp.launch(
        _smear_hits,
        dim=mask.shape,
        inputs=[mask, frame, ends, kinds, sigma],
        outputs=[near_out],
        device=mask.device,
    )
