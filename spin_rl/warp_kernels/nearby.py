# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportCallIssue=false
# pyright: reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Which obstacle slots are nearest to the robot, so that a scene costs what its surroundings cost."""

import warp as wp

from spin_rl.warp_kernels.geometry import rotate_yaw_inverse

NONE = wp.constant(-1)
"""Marks places of a list that no slot takes."""

REACH_M = wp.constant(1.3)
"""No part of the robot is farther from the base's origin than this, arm and gripper stretched out [m]."""

wp.set_module_options({"enable_backward": False})


@wp.func
def _distance(point: wp.vec2, centre: wp.vec3, yaw: float, half: wp.vec3, is_cylinder: bool) -> float:
    """Distance on the floor from a point to a slot [m], 0 inside."""
    offset = wp.vec3(point[0] - centre[0], point[1] - centre[1], 0.0)
    if is_cylinder:
        return wp.max(wp.length(offset) - half[0], 0.0)
    local = rotate_yaw_inverse(offset, wp.cos(yaw), wp.sin(yaw))
    return wp.length(
        wp.vec2(wp.max(wp.abs(local[0]) - half[0], 0.0), wp.max(wp.abs(local[1]) - half[1], 0.0))
    )


@wp.kernel
def _find_nearby(
    # In
    pos: wp.array2d(dtype=wp.vec3),
    yaw: wp.array2d(dtype=float),
    half_size: wp.array2d(dtype=wp.vec3),
    active: wp.array2d(dtype=bool),
    is_cylinder: wp.array(dtype=bool),
    qpos: wp.array2d(dtype=float),
    # Out
    distance_out: wp.array2d(dtype=float),
    nearby_out: wp.array2d(dtype=wp.int32),
    missed_out: wp.array(dtype=wp.int32),
):
    world = wp.tid()
    base = wp.vec2(qpos[world, 0], qpos[world, 1])
    most = nearby_out.shape[1]
    count = int(0)
    missed = int(0)
    for slot in range(pos.shape[1]):
        if active[world, slot]:
            centre = pos[world, slot]
            half = half_size[world, slot]
            # The bounding circle first: most slots of a large scene are farther than all that is listed.
            offset = wp.length(wp.vec2(centre[0] - base[0], centre[1] - base[1]))
            bound = offset - wp.length(wp.vec2(half[0], half[1]))
            if count < most or bound < wp.max(distance_out[world, most - 1], REACH_M):
                distance = _distance(base, centre, yaw[world, slot], half, is_cylinder[slot])
                if count == most and wp.max(distance_out[world, most - 1], distance) < REACH_M:
                    missed = 1
                if count < most or distance < distance_out[world, most - 1]:
                    # Insertion keeps the list sorted, the nearest first; equal ones by their slots.
                    count = wp.min(count + 1, most)
                    k = count - 1
                    while k > 0 and distance_out[world, k - 1] > distance:
                        distance_out[world, k] = distance_out[world, k - 1]
                        nearby_out[world, k] = nearby_out[world, k - 1]
                        k -= 1
                    distance_out[world, k] = distance
                    nearby_out[world, k] = slot
    for k in range(count, most):
        nearby_out[world, k] = NONE
    if missed == 1:
        wp.atomic_add(missed_out, 0, 1)


def find_nearby(
    pos: wp.array,
    yaw: wp.array,
    half_size: wp.array,
    active: wp.array,
    is_cylinder: wp.array,
    qpos: wp.array,
    *,
    distance_out: wp.array,
    nearby_out: wp.array,
    missed_out: wp.array,
) -> None:
    """List the slots nearest to the base's origin on the floor, the nearest first; graph-safe.

    Args:
        pos: Centre of each slot in the world [m], shape (nworld, nslot), vec3.
        yaw: Yaw of each slot [rad], shape (nworld, nslot).
        half_size: Half extents [m]; (r, r, half height) for cylinders, shape (nworld, nslot), vec3.
        active: Whether a slot is in use, shape (nworld, nslot), bool; others are never listed.
        is_cylinder: Kind of a slot, shape (nslot,), bool; others are boxes.
        qpos: Joint positions, shape (nworld, nq); columns 0 and 1 are the base's x and y [m].
        distance_out: Output, distances of the listed slots [m], shape (nworld, k).
        nearby_out: Output, the slots, `NONE` behind the last one, shape (nworld, k), int32.
        missed_out: Output, raised by one for every world with more slots within `REACH_M` than the list
            holds, shape (1,), int32.
    """
    wp.launch(
        _find_nearby,
        dim=pos.shape[0],
        inputs=[pos, yaw, half_size, active, is_cylinder, qpos],
        outputs=[distance_out, nearby_out, missed_out],
        device=pos.device,
    )
