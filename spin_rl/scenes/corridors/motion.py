# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportInvalidTypeForm=false
# pyright: reportCallIssue=false, reportOperatorIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Which obstacles of a corridor move, and how.

The corridor that the generator drew is the worst case: no obstacle ever reaches farther into the corridor
than there, so that the passage beside it stays free. Motion has random numbers of its own: corridors are the
same bits with and without it.
"""

import warp as wp

from spin_rl.scenes.corridors.params import HIDDEN_DEPTH_M, GeneratorParams
from spin_rl.scenes.layout import Layout
from spin_rl.scenes.motion import Track, track_of

_DEPTH = wp.constant(HIDDEN_DEPTH_M)
_PATROL_START = wp.constant(1.0)
"""Obstacles nearer than this to the start do not patrol [m]: the arm may reach that far at the start."""

_LEAST_RETREAT = wp.constant(0.3)
_MOST_RETREAT = wp.constant(0.8)
"""How far obstacles that patrol go back, as a share of the way into their wall."""

wp.set_module_options({"enable_backward": False})


def draw_motion(
    layout: Layout, params: GeneratorParams, *, seed: wp.array, counter: wp.array, mask: wp.array
) -> None:
    """Draw which obstacles of the masked worlds' new corridors move, and how; graph-safe.

    Obstacles move across the corridor, to the nearer wall and back to where the generator put them. Those too
    near to the start stay there: within their trigger distance, or within 1 m for those that patrol. Walls
    and distractors never move.

    Args:
        layout: Corridors that the generator has just drawn; its motion arrays are the output.
        params: Shares, trigger distances and speeds.
        seed: Random seed, shape (1,), int32.
        counter: Layouts drawn so far, the present ones included, shape (nworld,), int32.
        mask: Worlds to write, shape (nworld,), bool.
    """
    wp.launch(
        _draw_motion,
        dim=(layout.nworld, layout.pool.num_slots),
        inputs=[
            params.emerging_share,
            params.patrolling_share,
            wp.vec2(*params.emerging_trigger),
            wp.vec2(*params.motion_speed),
            layout.pool.first_box,
            layout.pool.first_cylinder,
            seed,
            counter,
            mask,
            layout.pos,
            layout.yaw,
            layout.half_size,
            layout.active,
            layout.start,
            layout.goal,
            layout.bend,
            layout.num_obstacles,
        ],
        outputs=[track_of(layout)],
        device=layout.device,
    )


@wp.func
def _way_into_wall(yaw: float, half: wp.vec3, across: wp.vec2, off: float, width: float) -> wp.vec2:
    """What takes an obstacle at `off` from the corridor's centre line across it, wholly into its wall."""
    c = wp.cos(yaw)
    s = wp.sin(yaw)
    # Half extent across of the turned bounding box.
    along_x = half[0] * wp.abs(c * across[0] + s * across[1])
    along_y = half[1] * wp.abs(c * across[1] - s * across[0])
    way = 0.5 * width + _DEPTH - (wp.abs(off) - along_x - along_y)
    return wp.sign(off) * way * across


@wp.kernel
def _draw_motion(
    # Parameters
    emerging_share: float,
    patrolling_share: float,
    trigger_range: wp.vec2,
    speed_range: wp.vec2,
    first_box: int,
    first_cylinder: int,
    # In
    seed: wp.array(dtype=wp.int32),
    counter: wp.array(dtype=wp.int32),
    mask: wp.array(dtype=bool),
    pos: wp.array2d(dtype=wp.vec3),
    yaw: wp.array2d(dtype=float),
    half_size: wp.array2d(dtype=wp.vec3),
    active: wp.array2d(dtype=bool),
    start: wp.array(dtype=wp.vec3),
    goal: wp.array(dtype=wp.vec2),
    bend: wp.array(dtype=wp.int32),
    num_obstacles: wp.array(dtype=wp.int32),
    # Out
    track: Track,
) -> None:
    world, slot = wp.tid()
    if not mask[world]:
        return
    track.speed[world, slot] = 0.0
    # Obstacles take the first boxes, distractors the last ones; all cylinders are obstacles.
    boxes = num_obstacles[world]
    for cylinder in range(first_cylinder, active.shape[1]):
        if active[world, cylinder]:
            boxes -= 1
    if slot < first_box or not active[world, slot] or (slot >= first_box + boxes and slot < first_cylinder):
        return

    stream = int(wp.rand_init(int(wp.rand_init(seed[0], world)), counter[world] - 1))
    state = wp.rand_init(int(wp.rand_init(stream, 4)), slot)
    u = wp.randf(state)
    speed = wp.lerp(speed_range[0], speed_range[1], wp.randf(state))
    trigger = wp.lerp(trigger_range[0], trigger_range[1], wp.randf(state))
    share = wp.lerp(_LEAST_RETREAT, _MOST_RETREAT, wp.randf(state))
    phase = wp.randf(state)

    centre = pos[world, slot]
    # Wall 0 is on the inner or left side of the first leg, at half the width from its centre line.
    width = 2.0 * (wp.abs(pos[world, 0][1]) - half_size[world, 0][1])
    across = wp.vec2(0.0, 1.0)
    off = centre[1]
    if bend[world] != 0 and wp.abs(centre[1]) > 0.5 * width:
        across = wp.vec2(1.0, 0.0)
        off = centre[0] - goal[world][0]
    way = _way_into_wall(yaw[world, slot], half_size[world, slot], across, off, width)
    away = wp.length(wp.vec2(centre[0] - start[world][0], centre[1] - start[world][1]))

    track.home[world, slot] = centre
    if u < emerging_share and away > trigger:
        track.retreat[world, slot] = way
        track.speed[world, slot] = speed
        track.trigger[world, slot] = trigger
        track.phase[world, slot] = 0.0
    elif u >= emerging_share and u < emerging_share + patrolling_share and away > _PATROL_START:
        track.retreat[world, slot] = share * way
        track.speed[world, slot] = speed
        track.trigger[world, slot] = 0.0
        track.phase[world, slot] = phase
