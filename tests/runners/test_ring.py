"""The learner's book on shared sequences, and the weights that both processes share."""

import pytest
import torch
from distill_worlds import make_models

from spin_rl.runners.remote.collector import SharedWeights
from spin_rl.runners.remote.ring import Ring, RingConfig


def test_new_blocks_come_first_and_all_are_used_alike():
    ring = Ring(RingConfig(blocks=6, max_staleness=100, max_reuse=3))
    for slot in (4, 1, 3):
        ring.add(slot, version=0)
    order = []
    for iteration in range(5):
        slot = ring.choose(iteration)
        ring.use(slot, iteration)
        order.append(slot)
    assert order == [4, 1, 3, 4, 1]
    ring.add(0, version=5)
    assert ring.choose(5) == 0


def test_reuse_and_staleness_are_bounded():
    ring = Ring(RingConfig(blocks=4, max_staleness=2, max_reuse=2))
    ring.add(0, version=10)
    assert ring.use(ring.choose(10), 10) == (0, 1)
    assert ring.use(ring.choose(12), 12) == (2, 2)
    assert ring.choose(12) is None and ring.release(12) == [0]  # used up
    ring.add(0, version=10)
    ring.add(1, version=11)
    assert ring.choose(13) == 1  # block 0 is too old
    assert ring.release(13) == [0]
    assert ring.choose(14) is None and ring.release(14) == [1]


def test_old_used_blocks_make_room_and_unused_ones_do_not():
    ring = Ring(RingConfig(blocks=4, max_staleness=100, max_reuse=100))
    for slot in range(3):
        ring.add(slot, version=0)
    assert ring.release(1) == []  # none has been used, so the collector waits
    ring.use(1, 1)
    ring.use(2, 1)
    assert ring.release(1) == [1]
    assert ring.choose(1) == 0


@pytest.mark.parametrize(("key", "value"), [("blocks", 2), ("max_staleness", 0), ("max_reuse", 0)])
def test_a_ring_in_which_someone_would_wait_for_ever_is_refused(key, value):
    with pytest.raises(ValueError, match=rf"asynchronous\.{key} must be at least"):
        RingConfig(**{key: value})


def fill(model, number):
    """Set all that acting depends on: parameters, and the normalizer's statistics."""
    for value in model.state_dict().values():
        value.fill_(number)


def is_filled(model, number):
    return all((value == number).all() for value in model.state_dict().values())


def test_shared_weights_are_the_newest_whole_ones(monkeypatch):
    student, other = make_models()[0], make_models(seed=1)[0]
    assert dict(student.named_buffers())
    weights = SharedWeights(student)
    assert weights.load_into(other) == 0
    for number in (3, 7):
        fill(student, number)
        weights.publish(student, version=number)
    assert weights.load_into(other) == 7
    assert is_filled(other, 7)

    # The learner publishes twice while the weights are being read: they are read again.
    second = list(other.state_dict().values())[1]
    copy = torch.Tensor.copy_

    def interrupted(own, value):
        if own.data_ptr() == second.data_ptr():
            monkeypatch.undo()
            for number in (8, 9):
                fill(student, number)
                weights.publish(student, version=number)
        return copy(own, value)

    monkeypatch.setattr(torch.Tensor, "copy_", interrupted)
    assert weights.load_into(other) == 9
    assert is_filled(other, 9)
