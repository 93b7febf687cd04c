# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportArgumentType=false
# pyright: reportCallIssue=false, reportIndexIssue=false, reportOperatorIssue=false
# pyright: reportAssignmentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Errors of a map: scandot tokens as a robot would read them from one that it made itself.

Source: Miki et al. 2022, "Learning robust perceptive locomotion for quadrupedal robots in the wild", where a
height map is perturbed. A point of the map is here a corner of a token.

Everything is drawn from the seed, the world, its episode, the step and the token, so that there is no state.
"""

import warp as wp

from spin_rl.warp_kernels.tokens import NUM_CORNERS

POINT_XY = wp.constant(0)
POINT_Z = wp.constant(1)
FRAME_XY = wp.constant(2)
FRAME_Z = wp.constant(3)
OUTLIER = wp.constant(4)
OUTLIER_SHARE = wp.constant(5)
OFFSET_XY = wp.constant(6)
OFFSET_Z = wp.constant(7)
NUM_ERRORS = 8

_COORDINATES = wp.constant(3 * NUM_CORNERS)

wp.set_module_options({"enable_backward": False})


@wp.struct
class MapKinds:
    """Kinds of maps and how often each is drawn.

    Attributes:
        up_to: Sum of the shares of a kind and those before it, shape (nkind,); the last is 1.
        fixed: Sizes of the errors by the indices above, shape (nkind, 8): standard deviations [m], and one
            probability.
        rising: What is added to them times the world's training level, shape (nkind, 8).
    """

    up_to: wp.array[float]
    fixed: wp.array2d[float]
    rising: wp.array2d[float]


@wp.func
def _error(kinds: MapKinds, kind: int, index: int, level: float) -> float:
    return kinds.fixed[kind, index] + level * kinds.rising[kind, index]


@wp.func
def _kind(kinds: MapKinds, draw: float) -> int:
    """The kind that a number in [0, 1) falls to."""
    kind = int(0)
    while kind < kinds.up_to.shape[0] - 1 and draw >= kinds.up_to[kind]:
        kind += 1
    return kind


@wp.kernel
def perturb_tokens(
    # In
    tokens: wp.array3d(dtype=float),
    kinds: MapKinds,
    seed: wp.array(dtype=wp.int32),
    episode: wp.array(dtype=wp.int32),
    step: wp.array(dtype=wp.int32),
    level: wp.array(dtype=float),
    way: wp.array(dtype=float),
    way_left: wp.array(dtype=float),
    qpos: wp.array2d(dtype=float),
    # Out
    tokens_out: wp.array3d(dtype=float),
) -> None:
    """Read the tokens from a map with errors, one thread per world and token."""
    w, token = wp.tid()
    # Of the episode: a kind for either half of the way, and an offset that stays where it is in the world.
    state = wp.rand_init(seed[0] + 15485863, w * 1000003 + episode[w])
    at_start = wp.randf(state)
    in_middle = wp.randf(state)
    kind = _kind(kinds, wp.where(way_left[w] < 0.5 * way[w], in_middle, at_start))
    c = level[w]
    size = _error(kinds, kind, OFFSET_XY, c)
    east = size * wp.randn(state)
    north = size * wp.randn(state)
    up = _error(kinds, kind, OFFSET_Z, c) * wp.randn(state)
    cos_yaw = wp.cos(qpos[w, 2])
    sin_yaw = wp.sin(qpos[w, 2])
    # Of the step: where the robot believes that it is in the map.
    state = wp.rand_init(int(state), step[w])
    size = _error(kinds, kind, FRAME_XY, c)
    shift = wp.vec3(
        cos_yaw * east + sin_yaw * north + size * wp.randn(state),
        cos_yaw * north - sin_yaw * east + size * wp.randn(state),
        up + _error(kinds, kind, FRAME_Z, c) * wp.randn(state),
    )
    # Of the step and the point.
    state = wp.rand_init(int(state), token)
    point_xy = _error(kinds, kind, POINT_XY, c)
    point_z = _error(kinds, kind, POINT_Z, c)
    outlier = _error(kinds, kind, OUTLIER, c)
    share = _error(kinds, kind, OUTLIER_SHARE, c)
    for corner in range(NUM_CORNERS):
        known = tokens[w, token, _COORDINATES + corner]
        moved = wp.vec3(0.0)
        if known > 0.0:
            moved = shift + wp.vec3(
                point_xy * wp.randn(state), point_xy * wp.randn(state), point_z * wp.randn(state)
            )
            if wp.randf(state) < share:
                moved += outlier * wp.vec3(wp.randn(state), wp.randn(state), wp.randn(state))
        for axis in range(3):
            tokens_out[w, token, 3 * corner + axis] = tokens[w, token, 3 * corner + axis] + moved[axis]
        tokens_out[w, token, _COORDINATES + corner] = known
