# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportCallIssue=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false, reportArgumentType=false
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""How well scans fit into maps: for particles, and hill climbing from one pose (as in gmapping)."""

import warp as wp

from spin_rl.warp_kernels.grid_map.frame import Frame, cells_of, place, value_at

wp.set_module_options({"enable_backward": False})


@wp.func
def _fit(
    values: wp.array3d[float],
    frame: Frame,
    world: int,
    pose: wp.vec3,
    points: wp.array2d[wp.vec2],
    count: int,
    stride: int,
) -> float:
    """Sum of the values where every stride-th point of a scan is, seen from a pose."""
    total = float(0.0)
    for i in range(0, count, stride):
        total += value_at(values, world, cells_of(frame, world, place(pose, points[world, i])))
    return total


@wp.kernel
def _score(
    mask: wp.array[wp.bool],
    values: wp.array3d[float],
    frame: Frame,
    poses: wp.array2d[wp.vec3],
    points: wp.array2d[wp.vec2],
    counts: wp.array[int],
    stride: int,
    score_out: wp.array2d[float],
):
    world, i = wp.tid()
    if mask[world]:
        score_out[world, i] = _fit(values, frame, world, poses[world, i], points, counts[world], stride)


@wp.kernel
def _climb(
    mask: wp.array[wp.bool],
    values: wp.array3d[float],
    frame: Frame,
    points: wp.array2d[wp.vec2],
    counts: wp.array[int],
    stride: int,
    step_m: float,
    step_rad: float,
    halvings: int,
    poses_out: wp.array[wp.vec3],
    score_out: wp.array[float],
):
    world = wp.tid()
    if not mask[world]:
        return
    count = counts[world]
    pose = poses_out[world]
    best = _fit(values, frame, world, pose, points, count, stride)
    step = step_m
    turn = step_rad
    halved = int(0)
    while halved <= halvings:
        found = pose
        found_score = best
        for move in range(6):
            size = wp.where(move % 2 == 0, 1.0, -1.0)
            tried = pose
            if move < 2:
                tried = wp.vec3(pose[0] + size * step, pose[1], pose[2])
            elif move < 4:
                tried = wp.vec3(pose[0], pose[1] + size * step, pose[2])
            else:
                tried = wp.vec3(pose[0], pose[1], pose[2] + size * turn)
            score = _fit(values, frame, world, tried, points, count, stride)
            if score > found_score:
                found = tried
                found_score = score
        if found_score > best:
            pose = found
            best = found_score
        else:
            halved += 1
            step = 0.5 * step
            turn = 0.5 * turn
    poses_out[world] = pose
    score_out[world] = best


def score_poses(
    mask: wp.array,
    values: wp.array,
    frame: Frame,
    poses: wp.array,
    points: wp.array,
    counts: wp.array,
    *,
    stride: int,
    score_out: wp.array,
) -> None:
    """Sum the values of the cells in which a scan's points are, from every pose.

    Args:
        mask: Worlds, shape (nworld,), bool.
        values: Of the cells, shape (nworld, ny, nx).
        frame: Where the cells are.
        poses: Base poses (x [m], y [m], yaw [rad]), shape (nworld, n), vec3.
        points: Hits in the base frame [m], shape (nworld, beams), vec2.
        counts: How many of them there are, shape (nworld,), int32.
        stride: Which of them are looked at: every so many.
        score_out: Output, shape (nworld, n).
    """
    wp.launch(
        _score,
        dim=poses.shape,
        inputs=[mask, values, frame, poses, points, counts, stride],
        outputs=[score_out],
        device=mask.device,
    )


def climb_poses(
    mask: wp.array,
    values: wp.array,
    frame: Frame,
    points: wp.array,
    counts: wp.array,
    *,
    stride: int,
    step_m: float,
    step_rad: float,
    halvings: int,
    poses_out: wp.array,
    score_out: wp.array,
) -> None:
    """Move each masked world's pose to where its scan fits best nearby.

    It takes the best of six moves, along x, y and yaw, and halves them where none is better.

    Args:
        mask: Worlds, shape (nworld,), bool.
        values: As for `score_poses`.
        frame: Where the cells are.
        points: As for `score_poses`.
        counts: As for `score_poses`.
        stride: As for `score_poses`.
        step_m: First moves along x and y [m].
        step_rad: First turn [rad].
        halvings: How often they are halved.
        poses_out: Base poses, shape (nworld,), vec3; updated in place.
        score_out: Output, sums of values there, shape (nworld,).
    """
    wp.launch(
        _climb,
        dim=mask.shape,
        inputs=[mask, values, frame, points, counts, stride, step_m, step_rad, halvings],
        outputs=[poses_out, score_out],
        device=mask.device,
    )
