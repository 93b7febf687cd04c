"""How episodes end, and what is drawn when they begin."""

import warp as wp

RUNNING = wp.constant(0)
SUCCESS = wp.constant(1)
COLLISION = wp.constant(2)
TIMEOUT = wp.constant(3)
NON_FINITE = wp.constant(4)

OUTCOMES = ("running", "success", "collision", "timeout", "non_finite")


@wp.func
def draw_servos(
    seed: int,
    w: int,
    episode: int,
    lag_range: wp.array2d(dtype=float),
    speed_range: wp.array(dtype=float),
) -> wp.vec3:
    """Draw the time constants of base and joints [s] and the factor on all speeds of a world's episode."""
    rng = wp.rand_init(seed + 7919, w * 1000003 + episode)
    base = wp.randf(rng, lag_range[0, 0], lag_range[0, 1])
    joint = wp.randf(rng, lag_range[1, 0], lag_range[1, 1])
    return wp.vec3(base, joint, wp.randf(rng, speed_range[0], speed_range[1]))


@wp.func
def _copy_if_finite(row: wp.array2d(dtype=float), w: int, kept_out: wp.array2d(dtype=float)) -> bool:
    """Copy a world's values; return whether all are finite."""
    finite = bool(True)
    for i in range(row.shape[1]):
        kept_out[w, i] = row[w, i]
        if not wp.isfinite(row[w, i]):
            finite = False
    return finite


@wp.func
def keep_final_state(
    w: int,
    qpos: wp.array2d(dtype=float),
    qvel: wp.array2d(dtype=float),
    action: wp.array2d(dtype=float),
    final_qpos_out: wp.array2d(dtype=float),
    final_qvel_out: wp.array2d(dtype=float),
) -> bool:
    """Keep the state that a step ended in, before a reset; return whether it and the action are finite.

    If they are not, zeros are kept, so that the rewards of the step are finite; the task resets the world.
    """
    finite = _copy_if_finite(qpos, w, final_qpos_out)
    finite = _copy_if_finite(qvel, w, final_qvel_out) and finite
    for i in range(action.shape[1]):
        if not wp.isfinite(action[w, i]):
            finite = False
    if not finite:
        for i in range(qpos.shape[1]):
            final_qpos_out[w, i] = 0.0
        for i in range(qvel.shape[1]):
            final_qvel_out[w, i] = 0.0
    return finite


@wp.func
def moved_level(level: float, outcome: int, up: float, down: float) -> float:
    """Training level of a world after a step: higher after a success, lower after any other end."""
    if outcome == SUCCESS:
        return wp.min(level + up, 1.0)
    if outcome != RUNNING:
        return wp.max(level - down, 0.0)
    return level
