# pyright: reportGeneralTypeIssues=false, reportIndexIssue=false, reportOperatorIssue=false
# pyright: reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Where a camera would look that knows what the policy does not: at the unknown thing that matters next."""

import warp as wp

from spin_rl.warp_kernels.awareness import distance_to, is_known
from spin_rl.warp_kernels.memory import Memory
from spin_rl.warp_kernels.slots import Slots

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _find_next(
    # In
    slots: Slots,
    is_wall: wp.array[wp.bool],
    qpos: wp.array2d[float],
    qvel: wp.array2d[float],
    memory: Memory,
    fresh: int,
    lead: float,
    near: float,
    # Out
    slot_out: wp.array[int],
) -> None:
    world = wp.tid()
    x = qpos[world, 0]
    y = qpos[world, 1]
    nearest = near
    found = int(-1)
    for slot in range(slots.pos.shape[1]):
        if slots.active[world, slot] and not is_wall[slot]:
            away = distance_to(slots, world, slot, x + lead * qvel[world, 0], y + lead * qvel[world, 1])
            if away < nearest and not is_known(memory, slots, world, slot, fresh):
                nearest = away
                found = slot
    slot_out[world] = found


def find_next(
    slots: Slots,
    is_wall: wp.array,
    qpos: wp.array,
    qvel: wp.array,
    memory: Memory,
    *,
    fresh: int,
    lead: float,
    near: float,
    slot_out: wp.array,
) -> None:
    """Find the unknown thing that is nearest to where the base will be soon; graph-safe.

    Args:
        slots: Walls and things.
        is_wall: Whether a slot is a wall, which is no thing, shape (nslot,), bool.
        qpos: Positions; columns 0 and 1 are the base's x and y [m], shape (nworld, nq).
        qvel: Their rates of change [m/s], likewise.
        memory: What the camera has shown.
        fresh: Steps for which something that moves is known.
        lead: How soon [s].
        near: Only what is nearer to the base then counts [m].
        slot_out: Output, its slot, -1 where everything near is known, shape (nworld,), int32.
    """
    wp.launch(
        _find_next,
        dim=slot_out.shape[0],
        inputs=[slots, is_wall, qpos, qvel, memory, fresh, lead, near],
        outputs=[slot_out],
        device=slot_out.device,
    )
