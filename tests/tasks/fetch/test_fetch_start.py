"""A new fetch begins with nothing of the last one, and remembers where it has seen its object."""

import numpy as np
import pytest
import warp as wp

from spin_rl.tasks.fetch import start as fetch_start
from spin_rl.tasks.fetch import state as fetch_state
from spin_rl.tasks.pick.episode import Forces

# Told of the last fetch until the next one's first step, or written by it before they are read; the length is
# cleared with every episode's.
LEFT_OVER = {"reached", "picked", "length", "stand", "found", "rest", "mark"}
STARTS = [(1.0, 2.0, 0.3), (-1.0, 0.5, 0.0)]


def used_state(value, device):
    """The state of two worlds in which everything has a value."""
    state = fetch_state.make_state(len(STARTS), device)
    for name in fetch_state.FetchState.vars:
        array = getattr(state, name).numpy()
        getattr(state, name).assign(np.full(array.shape, value).astype(array.dtype))
    return state


def begin(state, mask, device):
    """Begin new fetches in the masked worlds; return all state and forces, by name."""
    n = len(STARTS)
    with wp.ScopedDevice(device):
        forces = Forces()
        forces.finger = wp.full((n, 2), 9.0, dtype=float)
        forces.table, forces.hard = wp.full(n, 9.0, dtype=float), wp.full(n, 99.0, dtype=float)
        forces.support = wp.zeros(n, dtype=bool)
        wp.launch(
            fetch_start.begin_fetches,
            dim=n,
            inputs=[
                wp.array(mask, dtype=bool),
                wp.array(STARTS, dtype=wp.vec3),
            ],
            outputs=[state, forces],
        )
    arrays = {name: getattr(state, name) for name in fetch_state.FetchState.vars}
    arrays |= {name: getattr(forces, name) for name in ("finger", "table", "hard", "support")}
    return {name: array.numpy() for name, array in arrays.items()}


@pytest.mark.parametrize("value", [1, 7])
def test_a_new_fetch_knows_nothing_of_the_last(device, value):
    fresh = begin(fetch_state.make_state(len(STARTS), device), [True, True], device)
    begun = begin(used_state(value, device), [True, False], device)
    for name in begun.keys() - LEFT_OVER:
        np.testing.assert_array_equal(begun[name][0], fresh[name][0], err_msg=name)
    assert not fresh["is_found"].any() and not fresh["hard"].any() and fresh["support"].all()
    np.testing.assert_allclose(fresh["home"], np.array(STARTS)[:, :2])
    # The other world's goes on.
    for name in fetch_state.FetchState.vars:
        assert (begun[name][1] == np.asarray(value).astype(begun[name].dtype)).all(), name
    assert (begun["hard"] == [0.0, 99.0]).all()


def test_the_place_where_the_object_was_seen_last_is_kept(device):
    state = fetch_state.make_state(2, device)
    looks = [([True, False], 1.0), ([False, False], 2.0), ([True, False], 3.0), ([False, True], 4.0)]
    found = []
    for seen, x in looks:
        at = wp.array([(x, 0.0, 0.5)] * 2, dtype=wp.vec3, device=device)
        seen = wp.array(seen, dtype=bool, device=device)
        wp.launch(fetch_start.watch_objects, dim=2, inputs=[seen, at], outputs=[state], device=device)
        found.append((state.is_found.numpy().tolist(), state.found.numpy()[:, 0].tolist()))
    assert found == [
        ([True, False], [1.0, 0.0]),
        ([True, False], [1.0, 0.0]),
        ([True, False], [3.0, 0.0]),
        ([True, True], [3.0, 4.0]),
    ]
