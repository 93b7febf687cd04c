# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportInvalidTypeForm=false
# pyright: reportCallIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Obstacles that move: some come out of their wall when the robot is near, some slide to and fro.

Generators draw which do, and how (`corridors/motion.py`); here they move.
"""

import warp as wp

from spin_rl.scenes.layout import Layout

wp.set_module_options({"enable_backward": False})


@wp.struct
class Track:
    """The arrays of a `Layout` that say how its slots move."""

    home: wp.array2d[wp.vec3]
    retreat: wp.array2d[wp.vec2]
    speed: wp.array2d[float]
    trigger: wp.array2d[float]
    phase: wp.array2d[float]
    moved: wp.array2d[float]


def restart_motion(layout: Layout, mask: wp.array) -> None:
    """Put the moving slots of the masked worlds where they start; graph-safe.

    Args:
        layout: `pos` and `moved` are the output.
        mask: Worlds to restart, shape (nworld,), bool.
    """
    wp.launch(
        _restart_motion,
        dim=(layout.nworld, layout.pool.num_slots),
        inputs=[mask, track_of(layout)],
        outputs=[layout.pos],
        device=layout.device,
    )


def move_slots(layout: Layout, qpos: wp.array, dt: float, geom_ids: wp.array, geom_xpos: wp.array) -> None:
    """Move what moves by one time step, in the layout and in physics; graph-safe.

    Args:
        layout: `pos` and `moved` are the output.
        qpos: Positions of the robot, x and y of the base first [m], shape (nworld, nq).
        dt: Time step [s].
        geom_ids: Geom of every slot, shape (nslot,), int32.
        geom_xpos: Output, `Data.geom_xpos` [m], shape (nworld, ngeom), vec3.
    """
    wp.launch(
        _move_slots,
        dim=(layout.nworld, layout.pool.num_slots),
        inputs=[qpos, geom_ids, layout.active, dt, track_of(layout)],
        outputs=[layout.pos, geom_xpos],
        device=layout.device,
    )


def track_of(layout: Layout) -> Track:
    """The arrays of a layout that say how its slots move."""
    track = Track()
    for name, array in (
        ("home", layout.home),
        ("retreat", layout.retreat),
        ("speed", layout.motion_speed),
        ("trigger", layout.motion_trigger),
        ("phase", layout.motion_phase),
        ("moved", layout.moved),
    ):
        setattr(track, name, array)
    return track


@wp.func
def _place(track: Track, world: int, slot: int) -> wp.vec3:
    """Where a moving slot is after the way it has gone."""
    retreat = track.retreat[world, slot]
    gone = track.moved[world, slot] / wp.max(wp.length(retreat), 1.0e-6)
    share = wp.max(1.0 - gone, 0.0)
    if track.trigger[world, slot] == 0.0:
        # Out and back is one period of 2 retreats.
        turn = track.phase[world, slot] + 0.5 * gone
        share = wp.abs(2.0 * (turn - wp.floor(turn)) - 1.0)
    home = track.home[world, slot]
    return wp.vec3(home[0] + share * retreat[0], home[1] + share * retreat[1], home[2])


@wp.kernel
def _restart_motion(
    # In
    mask: wp.array(dtype=bool),
    # In and out
    track: Track,
    # Out
    pos_out: wp.array2d(dtype=wp.vec3),
) -> None:
    world, slot = wp.tid()
    if not mask[world]:
        return
    track.moved[world, slot] = 0.0
    if track.speed[world, slot] > 0.0:
        pos_out[world, slot] = _place(track, world, slot)


@wp.kernel
def _move_slots(
    # In
    qpos: wp.array2d(dtype=float),
    geom_ids: wp.array(dtype=wp.int32),
    active: wp.array2d(dtype=bool),
    dt: float,
    # In and out
    track: Track,
    # Out
    pos_out: wp.array2d(dtype=wp.vec3),
    geom_xpos_out: wp.array2d(dtype=wp.vec3),
) -> None:
    world, slot = wp.tid()
    speed = track.speed[world, slot]
    if speed == 0.0 or not active[world, slot]:
        return
    home = track.home[world, slot]
    trigger = track.trigger[world, slot]
    waits = trigger > 0.0 and track.moved[world, slot] == 0.0
    away = wp.length(wp.vec2(qpos[world, 0] - home[0], qpos[world, 1] - home[1]))
    if waits and not away < trigger:
        return
    track.moved[world, slot] += speed * dt
    place = _place(track, world, slot)
    pos_out[world, slot] = place
    geom_xpos_out[world, geom_ids[slot]] = place
