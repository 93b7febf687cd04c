# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportCallIssue=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""What the cells of a distance field are, and the values around the goal, from which the others spread."""

import warp as wp

from spin_rl.warp_kernels.distance_field.field import UNREACHABLE, Field, cell_centre
from spin_rl.warp_kernels.geometry import ray_box, ray_cylinder, rotate_yaw_inverse
from spin_rl.warp_kernels.slots import Slots

FREE, SLOW, BLOCKED, SOLID = (wp.constant(i) for i in range(4))
"""A cell's kind: its centre is farther than ``clearance`` from obstacles, nearer, so near that no way leads
through, or inside one."""

KIND = wp.constant(3)
"""Bits of the kind."""

BORDER = wp.constant(4)
"""Flag of the outermost cells, which lack neighbours: they never get values. The solver's flags are above."""

NEAR = wp.constant(6)
"""Cells around the goal with exact values."""

wp.set_module_options({"enable_backward": False})


@wp.func
def _offset(obstacles: Slots, world: int, slot: int, point: wp.vec2) -> wp.vec3:
    """A point on the floor in a slot's frame; z = 0 is the slot's middle."""
    centre = obstacles.pos[world, slot]
    yaw = obstacles.yaw[world, slot]
    offset = wp.vec3(point[0] - centre[0], point[1] - centre[1], 0.0)
    return rotate_yaw_inverse(offset, wp.cos(yaw), wp.sin(yaw))


@wp.func
def _distance_squared(is_cylinder: bool, half: wp.vec3, offset: wp.vec3) -> float:
    """Squared horizontal distance of a point in the slot's frame to it [m^2]; 0 inside."""
    if is_cylinder:
        outside = wp.max(wp.sqrt(offset[0] * offset[0] + offset[1] * offset[1]) - half[0], 0.0)
        return outside * outside
    x = wp.max(wp.abs(offset[0]) - half[0], 0.0)
    y = wp.max(wp.abs(offset[1]) - half[1], 0.0)
    return x * x + y * y


@wp.func
def _counts(obstacles: Slots, world: int, slot: int, ceiling: float) -> bool:
    """Whether a slot exists and does not hang above the robot."""
    bottom = obstacles.pos[world, slot][2] - obstacles.half_size[world, slot][2]
    return obstacles.active[world, slot] and bottom < ceiling


@wp.kernel
def _clear(
    mask: wp.array[wp.bool],
    goal: wp.array[wp.vec2],
    box: wp.array[wp.vec4i],
    lanes: int,
    # Out
    field: Field,
    kinds_out: wp.array3d[int],
):
    world, lane = wp.tid()
    if not mask[world]:
        return
    if lane == 0:
        field.goal[world] = goal[world]
    rows = field.values.shape[1]
    columns = field.values.shape[2]
    dirty = box[world]
    for row in range(dirty[1] + lane, 1 - dirty[3], lanes):
        for column in range(dirty[0], 1 - dirty[2]):
            field.values[world, row, column] = UNREACHABLE
    for row in range(lane, rows, lanes):
        kind = wp.where(row == 0 or row == rows - 1, BORDER, FREE)
        for column in range(columns):
            kinds_out[world, row, column] = kind
        kinds_out[world, row, 0] = BORDER
        kinds_out[world, row, columns - 1] = BORDER


@wp.kernel
def _rasterize(
    mask: wp.array[wp.bool],
    obstacles: Slots,
    ceiling: float,
    clearance: float,
    blocked: float,
    lanes: int,
    field: Field,
    # Out
    kinds_out: wp.array3d[int],
):
    world, lane = wp.tid()
    if not mask[world]:
        return
    rows = field.values.shape[1]
    columns = field.values.shape[2]
    first = cell_centre(field, world, 0, 0)
    for slot in range(lane, obstacles.pos.shape[1], lanes):
        if _counts(obstacles, world, slot, ceiling):
            half = obstacles.half_size[world, slot]
            is_cylinder = obstacles.is_cylinder[slot]
            cos_yaw = wp.cos(obstacles.yaw[world, slot])
            sin_yaw = wp.sin(obstacles.yaw[world, slot])
            reach = wp.vec2(half[0], half[0])
            if not is_cylinder:
                reach = wp.vec2(
                    wp.abs(cos_yaw) * half[0] + wp.abs(sin_yaw) * half[1],
                    wp.abs(sin_yaw) * half[0] + wp.abs(cos_yaw) * half[1],
                )
            centre = obstacles.pos[world, slot]
            middle = (wp.vec2(centre[0], centre[1]) - first) / field.cell
            reach = (reach + wp.vec2(clearance, clearance)) / field.cell
            left = int(wp.clamp(wp.ceil(middle[0] - reach[0]), 0.0, float(columns)))
            right = int(wp.clamp(wp.floor(middle[0] + reach[0]), -1.0, float(columns - 1)))
            low = int(wp.clamp(wp.ceil(middle[1] - reach[1]), 0.0, float(rows)))
            high = int(wp.clamp(wp.floor(middle[1] + reach[1]), -1.0, float(rows - 1)))
            for row in range(low, high + 1):
                for column in range(left, right + 1):
                    offset = field.cell * wp.vec3(float(column) - middle[0], float(row) - middle[1], 0.0)
                    distance_sq = _distance_squared(
                        is_cylinder, half, rotate_yaw_inverse(offset, cos_yaw, sin_yaw)
                    )
                    if distance_sq < clearance * clearance:
                        kind = wp.where(distance_sq < blocked * blocked, BLOCKED, SLOW)
                        kind = wp.where(distance_sq <= 0.0, SOLID, kind)
                        border = kinds_out[world, row, column] & BORDER
                        wp.atomic_max(kinds_out, world, row, column, kind | border)


@wp.func
def _hides(obstacles: Slots, world: int, slot: int, margin: float, start: wp.vec2, end: wp.vec2) -> bool:
    """Whether a slot with a margin around it, seen from above, lies between two points."""
    origin = _offset(obstacles, world, slot, start)
    direction = _offset(obstacles, world, slot, end) - origin
    half = obstacles.half_size[world, slot] + wp.vec3(margin, margin, 0.0)
    if obstacles.is_cylinder[slot]:
        return ray_cylinder(origin, direction, half[0], half[2]) < 1.0
    return ray_box(origin, direction, half) < 1.0


@wp.kernel
def _seed(
    mask: wp.array[wp.bool],
    obstacles: Slots,
    ceiling: float,
    clearance: float,
    # Out
    field: Field,
):
    """Straight distances of the cells near the goal that see it past what ways keep clear of.

    They keep less clear of what the goal itself is near to.
    """
    world = wp.tid()
    if not mask[world]:
        return
    goal = field.goal[world]
    at = (goal - field.origin[world]) / field.cell
    rows = field.values.shape[1]
    columns = field.values.shape[2]
    if not (at[0] >= 1.0 and at[1] >= 1.0 and at[0] < float(columns - 1) and at[1] < float(rows - 1)):
        return
    reach = float(NEAR) * field.cell
    low = wp.max(int(at[1]) - NEAR, 1)
    high = wp.min(int(at[1]) + NEAR, rows - 2)
    left = wp.max(int(at[0]) - NEAR, 1)
    right = wp.min(int(at[0]) + NEAR, columns - 2)
    for row in range(low, high + 1):
        for column in range(left, right + 1):
            distance = wp.length(cell_centre(field, world, column, row) - goal)
            if distance <= reach:
                field.values[world, row, column] = distance
    for slot in range(obstacles.pos.shape[1]):
        if _counts(obstacles, world, slot, ceiling):
            offset = _offset(obstacles, world, slot, goal)
            distance = wp.sqrt(
                _distance_squared(obstacles.is_cylinder[slot], obstacles.half_size[world, slot], offset)
            )
            # The margin's corners are square: 0.7 keeps the goal outside.
            margin = wp.min(clearance, 0.7 * distance)
            if distance < reach + clearance:
                for row in range(low, high + 1):
                    for column in range(left, right + 1):
                        centre = cell_centre(field, world, column, row)
                        if _hides(obstacles, world, slot, margin, goal, centre):
                            field.values[world, row, column] = UNREACHABLE


def prepare_cells(
    obstacles: Slots,
    goal: wp.array,
    mask: wp.array,
    field: Field,
    *,
    kinds: wp.array,
    box: wp.array,
    ceiling: float,
    clearance: float,
    blocked: float,
    lanes: int,
) -> None:
    """Write kinds, goals and the values around the goal, which see it in a straight line; graph-safe.

    Arguments as in ``solve_distance_field``; a world's work is shared by ``lanes`` threads.
    """
    launch = {"dim": (mask.shape[0], lanes), "device": mask.device}
    wp.launch(_clear, inputs=[mask, goal, box, lanes], outputs=[field, kinds], **launch)
    wp.launch(
        _rasterize,
        inputs=[mask, obstacles, ceiling, clearance, blocked, lanes, field],
        outputs=[kinds],
        **launch,
    )
    wp.launch(
        _seed,
        dim=mask.shape[0],
        inputs=[mask, obstacles, ceiling, clearance],
        outputs=[field],
        device=mask.device,
    )
