# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Kernels that begin fetches, and the one that keeps in mind where the object was seen."""

import warp as wp

from spin_rl.sim.targets import ABSOLUTE
from spin_rl.tasks.fetch.state import REACH, FetchState
from spin_rl.tasks.pick.episode import Forces, clear_forces

wp.set_module_options({"enable_backward": False})


@wp.kernel
def watch_objects(
    # In
    seen: wp.array(dtype=bool),
    at: wp.array(dtype=wp.vec3),
    # Out
    state: FetchState,
) -> None:
    """Remember where objects were last seen, one thread per world."""
    w = wp.tid()
    if seen[w]:
        state.is_found[w] = True
        state.found[w] = at[w]


@wp.kernel
def prepare_fetches(
    # In
    mask: wp.array(dtype=bool),
    # Out
    mode_out: wp.array(dtype=wp.int32),
) -> None:
    """Let the masked worlds' actions drive, one thread per world."""
    w = wp.tid()
    if mask[w]:
        mode_out[w] = ABSOLUTE


@wp.kernel
def begin_fetches(
    # In
    mask: wp.array(dtype=bool),
    start: wp.array(dtype=wp.vec3),
    # Out
    state: FetchState,
    forces: Forces,
) -> None:
    """Begin the masked worlds' fetches, one thread per world."""
    w = wp.tid()
    if not mask[w]:
        return
    state.stage[w] = REACH
    state.time[w] = 0
    state.phase[w] = 0
    state.phase_time[w] = 0
    state.ready[w] = False
    state.held[w] = 0
    state.loose[w] = 0
    state.stuck[w] = 0
    state.detour[w] = False
    state.retries[w] = 0
    state.drops[w] = 0
    state.scrapes[w] = 0
    for i in range(state.stage_steps.shape[1]):
        state.stage_steps[w, i] = 0
    state.home[w] = wp.vec2(start[w][0], start[w][1])
    state.grip[w] = wp.vec2(0.0, 0.0)
    state.is_found[w] = False
    clear_forces(w, forces)
