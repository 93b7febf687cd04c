# pyright: reportGeneralTypeIssues=false, reportIndexIssue=false, reportOperatorIssue=false
# pyright: reportArgumentType=false, reportCallIssue=false, reportAssignmentType=false
# pyright: reportAttributeAccessIssue=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Which things come near the base in a step, and whether the camera had shown them before.

A thing is known where it was seen, as long as it has moved by less than ``MOVED_M`` since, and wherever it is
for ``FRESH_S`` after it was seen: the same as in ``analysis/sight``.
"""

import warp as wp

from spin_rl.warp_kernels.geometry import rotate_yaw_inverse
from spin_rl.warp_kernels.memory import Memory
from spin_rl.warp_kernels.slots import Slots

MOVED_M = wp.constant(0.05)
FRESH_S = 0.5

wp.set_module_options({"enable_backward": False})


@wp.func
def distance_to(slots: Slots, world: int, slot: int, x: float, y: float) -> float:
    """Horizontal distance of a point from a slot's box, or from a cylinder [m]; 0 inside."""
    offset = wp.vec3(x, y, 0.0) - slots.pos[world, slot]
    yaw = slots.yaw[world, slot]
    local = rotate_yaw_inverse(offset, wp.cos(yaw), wp.sin(yaw))
    half = slots.half_size[world, slot]
    if slots.is_cylinder[slot]:
        return wp.max(wp.length(wp.vec2(local[0], local[1])) - half[0], 0.0)
    out = wp.vec2(wp.max(wp.abs(local[0]) - half[0], 0.0), wp.max(wp.abs(local[1]) - half[1], 0.0))
    return wp.length(out)


@wp.func
def is_known(memory: Memory, slots: Slots, world: int, slot: int, fresh: int) -> bool:
    """Whether a slot was seen where it still is, or not more than so many steps ago."""
    seen_at = memory.seen_at[world, slot]
    if seen_at < 0:
        return False
    then = memory.pose[world, slot]
    now = slots.pos[world, slot]
    moved = wp.length(wp.vec2(now[0] - then[0], now[1] - then[1]))
    return moved <= MOVED_M or memory.step[world] - seen_at <= fresh


@wp.kernel
def _notice(
    # In
    slots: Slots,
    is_wall: wp.array[wp.bool],
    qpos: wp.array2d[float],
    memory: Memory,
    near: float,
    fresh: int,
    # In and out
    noticed: wp.array2d[wp.bool],
    # Out
    gain_out: wp.array[float],
) -> None:
    world = wp.tid()
    gain = float(0.0)
    for slot in range(noticed.shape[1]):
        if slots.active[world, slot] and not is_wall[slot] and not noticed[world, slot]:
            if distance_to(slots, world, slot, qpos[world, 0], qpos[world, 1]) < near:
                noticed[world, slot] = True
                gain += wp.where(is_known(memory, slots, world, slot, fresh), 1.0, -1.0)
    gain_out[world] = gain


@wp.kernel
def _forget(mask: wp.array[wp.bool], noticed: wp.array2d[wp.bool]) -> None:
    world, slot = wp.tid()
    if mask[world]:
        noticed[world, slot] = False


def notice(
    slots: Slots,
    is_wall: wp.array,
    qpos: wp.array,
    memory: Memory,
    *,
    near: float,
    fresh: int,
    noticed: wp.array,
    gain_out: wp.array,
) -> None:
    """Count the things that come near for the first time, known ones for and others against; graph-safe.

    Args:
        slots: Walls and things.
        is_wall: Whether a slot is a wall, which is no thing, shape (nslot,), bool.
        qpos: Positions; columns 0 and 1 are the base's x and y [m], shape (nworld, nq).
        memory: What the camera has shown, up to the observation before the step.
        near: Distance of the base that is near [m].
        fresh: Steps for which something that moves is known.
        noticed: What came near before, updated, shape (nworld, nslot), bool.
        gain_out: Output, known ones less the others, shape (nworld,).
    """
    wp.launch(
        _notice,
        dim=gain_out.shape[0],
        inputs=[slots, is_wall, qpos, memory, near, fresh],
        outputs=[noticed, gain_out],
        device=gain_out.device,
    )


def forget(mask: wp.array, noticed: wp.array) -> None:
    """Begin anew in the masked worlds, shape (nworld,), bool; graph-safe."""
    wp.launch(_forget, dim=noticed.shape, inputs=[mask], outputs=[noticed], device=mask.device)
