"""What the robot remembers of things: where it saw them, how much of them, and for how long."""

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

from spin_rl.sensors.memory import SeenThings
from spin_rl.warp_kernels.memory import Memory, is_remembered, recall_all
from spin_rl.warp_kernels.slots import slots_of

WORLDS, MAX_AGE = 3, 5
HALF = (0.4, 0.1, 0.5)


@wp.kernel
def _ask(memory: Memory, out: wp.array2d(dtype=bool)):
    world, slot = wp.tid()
    out[world, slot] = is_remembered(memory, world, slot)


class Place:
    """One box in every world, centred at (2, 1, 0.5) and turned by 0.3, seen as a test says."""

    def __init__(self, device):
        shape = (WORLDS, 1)
        self.device = device
        self.pos = np.tile([2.0, 1.0, 0.5], (WORLDS, 1, 1)).astype(np.float32)
        self.layout = SimpleNamespace(
            pos=wp.array(self.pos, dtype=wp.vec3, device=device),
            yaw=wp.full(shape, 0.3, dtype=float, device=device),
            half_size=wp.array(np.tile(HALF, (WORLDS, 1, 1)), dtype=wp.vec3, device=device),
            active=wp.full(shape, True, dtype=wp.bool, device=device),
            is_cylinder=wp.zeros(1, dtype=wp.bool, device=device),
        )
        self.nearby = wp.zeros(shape, dtype=wp.int32, device=device)
        self.qpos = wp.zeros((WORLDS, 3), dtype=float, device=device)
        self.visible = wp.zeros((WORLDS, 1, 32), dtype=float, device=device)
        scandots = SimpleNamespace(visible=self.visible)
        self.step = wp.zeros(WORLDS, dtype=wp.int32, device=device)
        self.seen = SeenThings(self.layout, self.nearby, self.qpos, scandots, self.step, MAX_AGE)

    def update(self):
        """Make a control step."""
        self.step.assign(self.step.numpy() + 1)
        self.seen.update()

    def see(self, low, high, base=(0.0, 0.0, 0.0), flags=(1.0,) * 8):
        """Show the part of the box between two corners of its own frame to a base at x, y, yaw."""
        self.qpos.assign(np.tile(np.float32(base), (WORLDS, 1)))
        ends = np.array([low, high])
        corners = np.array([[ends[i & 1, 0], ends[i >> 1 & 1, 1], ends[i >> 2, 2]] for i in range(8)])
        turn = lambda angle: np.array(  # noqa: E731
            [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
        )
        world = corners @ turn(0.3).T + self.pos[:, 0][:, None]
        local = (world - [base[0], base[1], 0.0]) @ turn(base[2])
        flags = np.tile(np.float32(flags), (WORLDS, 1))
        tokens = np.concatenate([(local * flags[..., None]).reshape(WORLDS, 24), flags], -1)
        self.visible.assign(tokens[:, None].astype(np.float32))
        self.update()

    def look_away(self, steps=1):
        self.visible.zero_()
        for _ in range(steps):
            self.update()

    def box(self, world=0):
        memory = self.seen.memory
        return memory.low.numpy()[world, 0], memory.high.numpy()[world, 0]

    def remembered(self):
        out = wp.zeros((WORLDS, 1), dtype=bool, device=self.device)
        wp.launch(_ask, dim=out.shape, inputs=[self.seen.memory], outputs=[out], device=self.device)
        return out.numpy()[:, 0].tolist()


@pytest.fixture
def place(device):
    return Place(device)


def test_the_parts_of_a_thing_that_were_seen_from_anywhere_add_up(place):
    place.see((-0.4, -0.1, -0.5), (0.0, 0.1, 0.0))
    np.testing.assert_allclose(place.box(), [(-0.4, -0.1, -0.5), (0.0, 0.1, 0.0)], atol=1e-5)
    place.see((-0.1, -0.1, -0.2), (0.3, 0.1, 0.4), base=(1.0, -2.0, 2.5))
    np.testing.assert_allclose(place.box(), [(-0.4, -0.1, -0.5), (0.3, 0.1, 0.4)], atol=1e-5)


def test_of_a_small_thing_one_corner_tells_all(place):
    place.see((-0.4, -0.1, -0.5), (0.0, 0.1, 0.0), flags=(0, 0, 1, 0, 0, 0, 0, 0))
    np.testing.assert_allclose(place.box(), [-np.array(HALF), HALF], atol=1e-6)


def test_what_is_not_seen_again_is_forgotten_in_time(place):
    place.see((-0.4, -0.1, -0.5), (0.0, 0.1, 0.0))
    place.look_away(MAX_AGE)
    assert place.remembered() == [True] * WORLDS
    place.look_away()
    assert place.remembered() == [False] * WORLDS
    # Then only what is seen now counts.
    place.see((-0.1, -0.1, -0.2), (0.3, 0.1, 0.4))
    np.testing.assert_allclose(place.box(), [(-0.1, -0.1, -0.2), (0.3, 0.1, 0.4)], atol=1e-5)


def test_a_new_episode_knows_nothing(place):
    place.see((-0.4, -0.1, -0.5), (0.0, 0.1, 0.0))
    place.seen.begin(wp.array([False, True, False], dtype=bool, device=place.device))
    assert place.remembered() == [True, False, True]


def test_a_thing_that_moves_is_where_it_was_seen_last_and_as_fast(place):
    place.see((-0.4, -0.1, -0.5), (0.4, 0.1, 0.5))
    place.look_away()
    place.pos[:, 0, 0] += 0.1
    place.layout.pos.assign(place.pos)
    place.see((-0.4, -0.1, -0.5), (0.0, 0.1, 0.0))
    memory = place.seen.memory
    np.testing.assert_allclose(memory.pose.numpy()[0, 0], (2.1, 1.0, 0.3), atol=1e-6)
    np.testing.assert_allclose(memory.velocity.numpy()[0, 0], (0.05, 0.0), atol=1e-5)
    # What was seen of it elsewhere does not add up.
    np.testing.assert_allclose(place.box(), [(-0.4, -0.1, -0.5), (0.0, 0.1, 0.0)], atol=1e-5)
    # Whoever starts other worlds anew looks again in the same step.
    place.seen.update()
    np.testing.assert_allclose(memory.velocity.numpy()[0, 0], (0.05, 0.0), atol=1e-5)
    place.see((-0.4, -0.1, -0.5), (0.0, 0.1, 0.0))
    assert not memory.velocity.numpy().any()


def test_news_are_told_once(place):
    changed = place.seen.memory.changed
    place.see((-0.4, -0.1, -0.5), (0.0, 0.1, 0.0))
    assert changed.numpy().all()
    changed.zero_()
    place.see((-0.4, -0.1, -0.5), (0.01, 0.1, 0.0))  # no more than a centimetre of it is new
    assert not changed.numpy().any()
    place.see((-0.4, -0.1, -0.5), (0.2, 0.1, 0.0))
    assert changed.numpy().all()
    changed.zero_()
    place.pos[:, 0, 0] += 0.1
    place.layout.pos.assign(place.pos)
    place.see((-0.4, -0.1, -0.5), (0.2, 0.1, 0.0))
    assert changed.numpy().all()


def test_what_moves_is_forgotten_sooner(place):
    place.seen.memory.max_age = 1000
    place.see((-0.4, -0.1, -0.5), (0.4, 0.1, 0.5))
    place.look_away(101)
    assert place.remembered() == [True] * WORLDS
    place.pos[:, 0, 0] += 0.1
    place.layout.pos.assign(place.pos)
    place.see((-0.4, -0.1, -0.5), (0.4, 0.1, 0.5))
    place.look_away(100)
    assert place.remembered() == [True] * WORLDS
    place.look_away(1)
    assert place.remembered() == [False] * WORLDS


def test_all_that_is_remembered_is_recalled_as_slots(place):
    known = SimpleNamespace(
        pos=wp.zeros((WORLDS, 1), dtype=wp.vec3, device=place.device),
        yaw=wp.zeros((WORLDS, 1), dtype=float, device=place.device),
        half_size=wp.zeros((WORLDS, 1), dtype=wp.vec3, device=place.device),
        active=wp.full((WORLDS, 1), True, dtype=wp.bool, device=place.device),
        is_cylinder=wp.zeros(1, dtype=wp.bool, device=place.device),
    )
    slots = slots_of(known)
    everywhere = wp.full(WORLDS, True, dtype=wp.bool, device=place.device)
    recall_all(everywhere, place.seen.memory, place.seen.obstacles, slots)
    assert not known.active.numpy().any()
    place.see((-0.4, -0.1, -0.5), (0.0, 0.1, 0.3))
    first = wp.array([True, False, False], dtype=wp.bool, device=place.device)
    recall_all(first, place.seen.memory, place.seen.obstacles, slots)
    assert known.active.numpy()[:, 0].tolist() == [True, False, False]
    recall_all(everywhere, place.seen.memory, place.seen.obstacles, slots)
    assert known.active.numpy().all()
    np.testing.assert_allclose(known.half_size.numpy()[0, 0], (0.2, 0.1, 0.4), atol=1e-5)
    middle = (2.0 - 0.2 * np.cos(0.3), 1.0 - 0.2 * np.sin(0.3), 0.4)
    np.testing.assert_allclose(known.pos.numpy()[0, 0], middle, atol=1e-5)
    np.testing.assert_allclose(known.yaw.numpy()[0, 0], 0.3, atol=1e-6)
    # What moves counts as long as it is in view.
    place.pos[:, 0, 0] += 0.1
    place.layout.pos.assign(place.pos)
    place.see((-0.4, -0.1, -0.5), (0.0, 0.1, 0.3))
    for steps, is_there in ((5, True), (1, False)):
        place.look_away(steps)
        recall_all(everywhere, place.seen.memory, place.seen.obstacles, slots)
        assert bool(known.active.numpy().all()) == is_there
