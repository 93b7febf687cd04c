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
