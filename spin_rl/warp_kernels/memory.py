# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportInvalidTypeForm=false
# pyright: reportCallIssue=false, reportIndexIssue=false, reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""What the camera has seen of the obstacle slots, remembered as boxes.

What a token of visible scandots tells of a slot is kept as a box in the slot's frame, which grows while more
of the slot is seen. A slot that was seen to move is remembered where it was seen last, with the velocity that
two views of it tell. What was not seen for ``max_age`` steps is forgotten, what moves sooner.
"""

import warp as wp

from spin_rl.warp_kernels.geometry import MISS, rotate_yaw, rotate_yaw_inverse
from spin_rl.warp_kernels.slots import Slots, put_slot

_STILL_M = wp.constant(1.0e-3)
"""A slot that moved less than this since it was seen last has not moved [m, rad]."""

_MOVING_AGE = wp.constant(100)
"""Where a slot that moves may be is not known any more after so many steps."""
_IN_VIEW = wp.constant(5)
"""A slot that was seen so many steps ago counts as in view."""
_NEWS_M = wp.constant(0.02)
"""What is remembered has changed when a box has grown by this [m]."""

wp.set_module_options({"enable_backward": False})


@wp.struct
class Memory:
    """What was seen of the slots: boxes in their slots' frames; arrays of shape (nworld, nslot).

    ``low`` and ``high`` are opposite corners [m], ``pose`` is x, y and yaw of the slot when it was seen last
    [m, rad], ``velocity`` how fast it moved then [m per step], ``seen_at`` the step of that, negative where
    there is nothing to remember. ``step`` (nworld,) is the control step of the episode, written by others;
    ``changed`` (nworld,) is set where something new was seen, and cleared by who acts on it.
    """

    low: wp.array2d[wp.vec3]
    high: wp.array2d[wp.vec3]
    pose: wp.array2d[wp.vec3]
    velocity: wp.array2d[wp.vec2]
    seen_at: wp.array2d[int]
    step: wp.array[int]
    changed: wp.array[wp.bool]
    max_age: int


@wp.struct
class Thing:
    """A remembered box, upright, where it is expected now: the frame is the caller's.

    ``place`` is x, y and yaw [m, rad], ``drift`` its velocity [m per step], ``half`` half extents across,
    ``height`` lowest and highest point [m].
    """

    place: wp.vec3
    drift: wp.vec2
    half: wp.vec2
    height: wp.vec2


@wp.func
def is_remembered(memory: Memory, world: int, slot: int) -> bool:
    """Whether a slot was seen, and not too long ago."""
    seen_at = memory.seen_at[world, slot]
    if seen_at < 0:
        return False
    age = memory.step[world] - seen_at
    if wp.length(memory.velocity[world, slot]) > 0.0 and age > _MOVING_AGE:
        return False
    return age <= memory.max_age


@wp.func
def recall(memory: Memory, slots: Slots, world: int, slot: int, base: wp.vec3) -> Thing:
    """What is remembered of a slot, in the frame of a base at x, y [m] and yaw [rad]."""
    low = memory.low[world, slot]
    high = memory.high[world, slot]
    pose = memory.pose[world, slot]
    velocity = memory.velocity[world, slot]
    age = float(memory.step[world] - memory.seen_at[world, slot])
    middle = rotate_yaw(0.5 * (low + high), wp.cos(pose[2]), wp.sin(pose[2]))
    x = pose[0] + middle[0] + age * velocity[0] - base[0]
    y = pose[1] + middle[1] + age * velocity[1] - base[1]
    cos_yaw = wp.cos(base[2])
    sin_yaw = wp.sin(base[2])
    thing = Thing()
    thing.place = wp.vec3(cos_yaw * x + sin_yaw * y, cos_yaw * y - sin_yaw * x, pose[2] - base[2])
    thing.drift = wp.vec2(
        cos_yaw * velocity[0] + sin_yaw * velocity[1], cos_yaw * velocity[1] - sin_yaw * velocity[0]
    )
    thing.half = wp.vec2(0.5 * (high[0] - low[0]), 0.5 * (high[1] - low[1]))
    height = slots.pos[world, slot][2]  # nothing moves up or down
    thing.height = wp.vec2(height + low[2], height + high[2])
    return thing


@wp.kernel
def _recall_all(mask: wp.array[wp.bool], memory: Memory, slots: Slots, known_out: Slots):
    world, slot = wp.tid()
    if not mask[world]:
        return
    known = is_remembered(memory, world, slot)
    if known and wp.length(memory.velocity[world, slot]) > 0.0:
        known = memory.step[world] - memory.seen_at[world, slot] <= _IN_VIEW
    known_out.active[world, slot] = known
    if known:
        thing = recall(memory, slots, world, slot, wp.vec3(0.0, 0.0, 0.0))
        height = thing.height
        pos = wp.vec3(thing.place[0], thing.place[1], 0.5 * (height[0] + height[1]))
        half = wp.vec3(thing.half[0], thing.half[1], 0.5 * (height[1] - height[0]))
        put_slot(world, slot, pos, thing.place[2], half, known_out)


@wp.kernel
def _forget(mask: wp.array[wp.bool], memory: Memory):
    world, slot = wp.tid()
    if mask[world]:
        memory.seen_at[world, slot] = -1


@wp.kernel
def _remember(
    slots: Slots, nearby: wp.array2d[int], qpos: wp.array2d[float], visible: wp.array3d[float], memory: Memory
):
    """Take in what one token tells of its slot."""
    world, token = wp.tid()
    slot = nearby[world, token]
    if slot < 0:
        return
    pos = slots.pos[world, slot]
    yaw = slots.yaw[world, slot]
    base = wp.vec3(qpos[world, 0], qpos[world, 1], 0.0)
    known = float(0.0)
    low = wp.vec3(MISS, MISS, MISS)
    high = wp.vec3(-MISS, -MISS, -MISS)
    for index in range(8):
        flag = visible[world, token, 24 + index]
        if flag > 0.0:
            corner_b = wp.vec3(
                visible[world, token, 3 * index],
                visible[world, token, 3 * index + 1],
                visible[world, token, 3 * index + 2],
            )
            offset = base + rotate_yaw(corner_b, wp.cos(qpos[world, 2]), wp.sin(qpos[world, 2])) - pos
            corner = rotate_yaw_inverse(offset, wp.cos(yaw), wp.sin(yaw))
            low = wp.min(low, corner)
            high = wp.max(high, corner)
            known += flag
    if known == 0.0:
        return
    if known < 8.0:  # a small thing, seen in part
        high = slots.half_size[world, slot]
        low = -high
    pose = wp.vec3(pos[0], pos[1], yaw)
    velocity = wp.vec2(0.0, 0.0)
    if memory.seen_at[world, slot] == memory.step[world]:  # a second look in this step tells no motion
        velocity = memory.velocity[world, slot]
    is_news = not is_remembered(memory, world, slot)
    if not is_news:
        moved = pose - memory.pose[world, slot]
        is_news = wp.length(moved) >= _STILL_M
        if not is_news:
            grown = wp.max(memory.low[world, slot] - low, high - memory.high[world, slot])
            is_news = wp.max(grown) > _NEWS_M
            low = wp.min(low, memory.low[world, slot])
            high = wp.max(high, memory.high[world, slot])
        else:
            steps = float(wp.max(memory.step[world] - memory.seen_at[world, slot], 1))
            velocity = wp.vec2(moved[0], moved[1]) / steps
    if is_news:
        memory.changed[world] = True
    memory.low[world, slot] = low
    memory.high[world, slot] = high
    memory.pose[world, slot] = pose
    memory.velocity[world, slot] = velocity
    memory.seen_at[world, slot] = memory.step[world]


def forget(memory: Memory, mask: wp.array) -> None:
    """Forget everything in the masked worlds, shape (nworld,), bool; graph-safe."""
    wp.launch(_forget, dim=memory.seen_at.shape, inputs=[mask, memory], device=mask.device)


def remember(slots: Slots, nearby: wp.array, qpos: wp.array, visible: wp.array, memory: Memory) -> None:
    """Take in what the visible tokens tell; graph-safe, more than once a control step where nothing moved.

    Args:
        slots: Walls and obstacles.
        nearby: Slots of the tokens, shape (nworld, k), int32, negative ones behind the last.
        qpos: Joint positions, shape (nworld, nq); columns 0 to 2 are the base's x, y [m] and yaw [rad].
        visible: Tokens of what the camera sees, shape (nworld, k, 32), float.
        memory: What was seen before; changed.
    """
    device = nearby.device
    wp.launch(_remember, dim=nearby.shape, inputs=[slots, nearby, qpos, visible, memory], device=device)


def recall_all(mask: wp.array, memory: Memory, slots: Slots, known_out: Slots) -> None:
    """Put what is remembered where it is expected, what moves only while it is in view; graph-safe.

    Args:
        mask: Worlds to do it in, shape (nworld,), bool; the others' slots stay.
        memory: What was seen.
        slots: Walls and obstacles, for their heights.
        known_out: Output, boxes in as many slots; inactive where nothing is remembered.
    """
    wp.launch(
        _recall_all,
        dim=memory.seen_at.shape,
        inputs=[mask, memory, slots],
        outputs=[known_out],
        device=memory.seen_at.device,
    )
