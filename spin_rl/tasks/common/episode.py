# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportCallIssue=false
# pyright: reportIndexIssue=false, reportArgumentType=false, reportAttributeAccessIssue=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""How episodes end, and what is drawn when they begin."""

import warp as wp

RUNNING = wp.constant(0)
SUCCESS = wp.constant(1)
COLLISION = wp.constant(2)
TIMEOUT = wp.constant(3)
NON_FINITE = wp.constant(4)

LARGEST_STATE = wp.constant(1.0e4)
"""Of positions [m, rad] and velocities [m/s, rad/s]: a world beyond it has burst and counts as non-finite."""

OUTCOMES = ("running", "success", "collision", "timeout", "non_finite")

wp.set_module_options({"enable_backward": False})


@wp.struct
class StepEnd:
    """How a control step left every world, before those that ended are reset; leading axis nworld."""

    qpos: wp.array2d[float]
    qvel: wp.array2d[float]
    outcome: wp.array[int]
    done: wp.array[wp.bool]


@wp.func
def _keep(w: int, row: wp.array2d[float], kept: wp.array2d[float]) -> bool:
    finite = bool(True)
    for i in range(row.shape[1]):
        kept[w, i] = row[w, i]
        if not (wp.abs(row[w, i]) <= LARGEST_STATE):  # a NaN is not
            finite = False
    return finite


@wp.func
def keep_state(
    w: int, qpos: wp.array2d[float], qvel: wp.array2d[float], action: wp.array2d[float], end: StepEnd
) -> bool:
    """Keep a world's positions and velocities; whether they and the action are sound, else zeros are kept.

    Zeros keep the rewards of the step finite; the world itself is to be reset.
    """
    finite = _keep(w, qpos, end.qpos)
    finite = _keep(w, qvel, end.qvel) and finite
    for i in range(action.shape[1]):
        if not wp.isfinite(action[w, i]):
            finite = False
    if not finite:
        for i in range(qpos.shape[1]):
            end.qpos[w, i] = 0.0
        for i in range(qvel.shape[1]):
            end.qvel[w, i] = 0.0
    return finite


@wp.func
def put_outcome(w: int, outcome: int, end: StepEnd) -> None:
    """Write how a world's episode ended, or that it goes on."""
    end.outcome[w] = outcome
    end.done[w] = outcome != RUNNING


@wp.func
def move_level(w: int, outcome: int, up: float, down: float, level: wp.array[float]) -> None:
    """Move a world's level up after a success and down after any other end, within [0, 1]."""
    if outcome == SUCCESS:
        level[w] = wp.min(level[w] + up, 1.0)
    elif outcome != RUNNING:
        level[w] = wp.max(level[w] - down, 0.0)


@wp.kernel
def choose_non_finite(
    # In
    outcome: wp.array(dtype=wp.int32),
    # Out
    chosen_out: wp.array(dtype=bool),
) -> None:
    """Choose the worlds that turned non-finite: nothing in them may be read."""
    w = wp.tid()
    chosen_out[w] = outcome[w] == NON_FINITE


@wp.kernel
def begin(
    # In
    mask: wp.array(dtype=bool),
    seed: wp.array(dtype=wp.int32),
    lag_range: wp.array2d(dtype=float),
    scale_range: wp.array2d(dtype=float),
    # In and out
    counter: wp.array(dtype=wp.int32),
    # Out
    length_out: wp.array(dtype=wp.int32),
    lag_out: wp.array2d(dtype=float),
    speed_scale_out: wp.array(dtype=float),
    acceleration_scale_out: wp.array(dtype=float),
) -> None:
    """Count the masked worlds' steps anew, and draw the servos' time constants [s] and factors."""
    w = wp.tid()
    if not mask[w]:
        return
    length_out[w] = 0
    rng = wp.rand_init(seed[0] + 7919, w * 1000003 + counter[w])
    counter[w] = counter[w] + 1
    lag_out[w, 0] = wp.randf(rng, lag_range[0, 0], lag_range[0, 1])
    lag_out[w, 1] = wp.randf(rng, lag_range[1, 0], lag_range[1, 1])
    speed_scale_out[w] = wp.randf(rng, scale_range[0, 0], scale_range[0, 1])
    acceleration_scale_out[w] = wp.randf(rng, scale_range[1, 0], scale_range[1, 1])
