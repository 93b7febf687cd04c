# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Kernels that end and begin navigation episodes on the device."""

from typing import Any

import warp as wp

from spin_rl.tasks.common.episode import (
    COLLISION,
    NON_FINITE,
    RUNNING,
    SUCCESS,
    TIMEOUT,
    StepEnd,
    keep_state,
    move_level,
    put_outcome,
)
from spin_rl.tasks.nav.ways import Ways, distance_to_go, limit_time, way_to_go

wp.set_module_options({"enable_backward": False})


@wp.struct
class NavRules:
    """When an episode ends; see `NavConfig`."""

    goal_tolerance_m: float
    stop_on_collision: bool
    level_up: float
    level_down: float


@wp.struct
class Trips:
    """How long the way was at every world's start and how far its base drove [m], shape (nworld,) each.

    ``way``, ``driven`` and ``place``, the base's last position, are those of the running episode, and
    ``to_via`` whether it still drives to the layout's place before the goal; ``final_way`` and
    ``final_driven`` are those at the end of the last step, before worlds that ended began anew.
    """

    way: wp.array[float]
    driven: wp.array[float]
    place: wp.array[wp.vec2]
    to_via: wp.array[wp.bool]
    final_way: wp.array[float]
    final_driven: wp.array[float]


@wp.func
def drive_on(trips: Trips, w: int, x: float, y: float) -> None:
    """Add the straight line from where a base was before the step to the path that it drove."""
    place = wp.vec2(x, y)
    trips.driven[w] = trips.driven[w] + wp.length(place - trips.place[w])
    trips.place[w] = place


@wp.kernel
def end_episodes(
    # In
    qpos: wp.array2d(dtype=float),
    qvel: wp.array2d(dtype=float),
    action: wp.array2d(dtype=float),
    layout_goal: wp.array(dtype=wp.vec2),
    part_contacts: wp.array2d(dtype=bool),
    rules: NavRules,
    ways: Ways,
    # In and out
    episode_length: wp.array(dtype=wp.int32),
    goal: wp.array(dtype=wp.vec2),
    distance: wp.array(dtype=float),
    level: wp.array(dtype=float),
    trips: Trips,
    # Out
    progress_out: wp.array(dtype=float),
    goal_distance_out: wp.array(dtype=float),
    end: StepEnd,
) -> None:
    """Describe the control step just made and end episodes, one thread per world."""
    w = wp.tid()
    episode_length[w] = episode_length[w] + 1

    touched = bool(False)
    for part in range(part_contacts.shape[1]):
        if part_contacts[w, part]:
            touched = True

    outcome = RUNNING
    if not keep_state(w, qpos, qvel, action, end):
        outcome = NON_FINITE
        progress_out[w] = 0.0
        goal_distance_out[w] = distance[w]
    else:
        now = way_to_go(ways, w, qpos[w, 0], qpos[w, 1], goal[w], distance[w])
        straight = distance_to_go(qpos[w, 0], qpos[w, 1], goal[w], 0)
        progress_out[w] = distance[w] - now
        goal_distance_out[w] = straight
        distance[w] = now
        drive_on(trips, w, qpos[w, 0], qpos[w, 1])
        if touched and rules.stop_on_collision:
            outcome = COLLISION
        elif straight < rules.goal_tolerance_m and not trips.to_via[w]:
            outcome = SUCCESS
        elif episode_length[w] >= ways.most_steps[w]:
            outcome = TIMEOUT
        if straight < rules.goal_tolerance_m and trips.to_via[w]:
            trips.to_via[w] = False
            goal[w] = layout_goal[w]
            distance[w] = way_to_go(ways, w, qpos[w, 0], qpos[w, 1], goal[w], distance[w])
    trips.final_way[w] = trips.way[w]
    trips.final_driven[w] = trips.driven[w]
    put_outcome(w, outcome, end)
    move_level(w, outcome, rules.level_up, rules.level_down, level)


@wp.kernel
def begin_episodes(
    # In
    mask: wp.array(dtype=bool),
    qpos: wp.array2d(dtype=float),
    goal: wp.array(dtype=wp.vec2),
    layout_goal: wp.array(dtype=wp.vec2),
    speed_scale: wp.array(dtype=float),
    # In and out
    ways: Ways,
    trips: Trips,
    # Out
    distance_out: wp.array(dtype=float),
) -> None:
    """Begin the masked worlds' episodes at their start poses, one thread per world."""
    w = wp.tid()
    if mask[w]:
        straight = distance_to_go(qpos[w, 0], qpos[w, 1], goal[w], 0)
        way = way_to_go(ways, w, qpos[w, 0], qpos[w, 1], goal[w], straight)
        distance_out[w] = way
        trips.to_via[w] = ways.has_via[w]
        if ways.has_via[w]:
            way += wp.length(goal[w] - layout_goal[w])
        trips.way[w] = way
        trips.driven[w] = 0.0
        trips.place[w] = wp.vec2(qpos[w, 0], qpos[w, 1])
        limit_time(ways, w, way, speed_scale[w])


def make_trips(nworld: int, device: str) -> Any:
    """Allocate the struct for a number of worlds."""
    trips = Trips()
    with wp.ScopedDevice(device):
        for name in ("way", "driven", "final_way", "final_driven"):
            setattr(trips, name, wp.zeros(nworld, dtype=float))
        trips.place = wp.zeros(nworld, dtype=wp.vec2)
        trips.to_via = wp.zeros(nworld, dtype=bool)
    return trips
