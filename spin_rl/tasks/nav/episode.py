"""Kernels that end and begin navigation episodes on the device."""

import warp as wp

from spin_rl.tasks.common.episode import (
    COLLISION,
    NON_FINITE,
    RUNNING,
    SUCCESS,
    TIMEOUT,
    draw_servos,
    keep_final_state,
    moved_level,
)

wp.set_module_options({"enable_backward": False})


@wp.func
def distance_to_go(x: float, y: float, goal: wp.vec2, bend: int) -> float:
    """Path length left to the goal [m]: straight, or along the two legs of an L-shaped corridor.

    The legs lie along the world's axes, so the length along an L is the Manhattan distance: continuous, and
    shrinking all the way around the corner, where the straight distance would reward driving into the wall.
    """
    dx = goal[0] - x
    dy = goal[1] - y
    if bend != 0:
        return wp.abs(dx) + wp.abs(dy)
    return wp.sqrt(dx * dx + dy * dy)


@wp.kernel
def end_episodes(
    # In
    qpos: wp.array2d(dtype=float),
    qvel: wp.array2d(dtype=float),
    action: wp.array2d(dtype=float),
    goal: wp.array(dtype=wp.vec2),
    bend: wp.array(dtype=wp.int32),
    part_contacts: wp.array2d(dtype=bool),
    goal_tolerance: float,
    max_length: int,
    stop_on_collision: bool,
    level_up: float,
    level_down: float,
    # In and out
    episode_length: wp.array(dtype=wp.int32),
    distance: wp.array(dtype=float),
    level: wp.array(dtype=float),
    # Out
    progress_out: wp.array(dtype=float),
    goal_distance_out: wp.array(dtype=float),
    final_qpos_out: wp.array2d(dtype=float),
    final_qvel_out: wp.array2d(dtype=float),
    outcome_out: wp.array(dtype=wp.int32),
    done_out: wp.array(dtype=bool),
) -> None:
    """Describe the control step just made and end episodes, one thread per world."""
    w = wp.tid()
    episode_length[w] = episode_length[w] + 1

    finite = keep_final_state(w, qpos, qvel, action, final_qpos_out, final_qvel_out)

    touched = bool(False)
    for part in range(part_contacts.shape[1]):
        if part_contacts[w, part]:
            touched = True

    outcome = RUNNING
    if not finite:
        outcome = NON_FINITE
        progress_out[w] = 0.0
        goal_distance_out[w] = distance[w]
    else:
        now = distance_to_go(qpos[w, 0], qpos[w, 1], goal[w], bend[w])
        straight = distance_to_go(qpos[w, 0], qpos[w, 1], goal[w], 0)
        progress_out[w] = distance[w] - now
        goal_distance_out[w] = straight
        distance[w] = now
        if touched and stop_on_collision:
            outcome = COLLISION
        elif straight < goal_tolerance:
            outcome = SUCCESS
        elif episode_length[w] >= max_length:
            outcome = TIMEOUT
    outcome_out[w] = outcome
    done_out[w] = outcome != RUNNING
    level[w] = moved_level(level[w], outcome, level_up, level_down)


@wp.kernel
def begin_episodes(
    # In
    mask: wp.array(dtype=bool),
    qpos: wp.array2d(dtype=float),
    goal: wp.array(dtype=wp.vec2),
    bend: wp.array(dtype=wp.int32),
    seed: wp.array(dtype=wp.int32),
    lag_range: wp.array2d(dtype=float),
    speed_range: wp.array(dtype=float),
    # In and out
    counter: wp.array(dtype=wp.int32),
    # Out
    episode_length_out: wp.array(dtype=wp.int32),
    distance_out: wp.array(dtype=float),
    lag_out: wp.array2d(dtype=float),
    speed_scale_out: wp.array(dtype=float),
) -> None:
    """Begin the masked worlds' episodes at their start poses, one thread per world."""
    w = wp.tid()
    if not mask[w]:
        return
    episode_length_out[w] = 0
    distance_out[w] = distance_to_go(qpos[w, 0], qpos[w, 1], goal[w], bend[w])
    drawn = draw_servos(seed[0], w, counter[w], lag_range, speed_range)
    counter[w] = counter[w] + 1
    lag_out[w, 0] = drawn[0]
    lag_out[w, 1] = drawn[1]
    speed_scale_out[w] = drawn[2]
