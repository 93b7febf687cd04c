"""Which cameras see in time: hand-made cases with known answers, and cameras simulated step by step."""

import numpy as np
import pytest
import torch

from spin_rl import robot
from spin_rl.analysis.sight import judge
from spin_rl.analysis.sight.heads import Poses
from spin_rl.analysis.sight.options import SightOptions
from spin_rl.analysis.sight.record import Record, braked_time, going_on
from spin_rl.config import ConfigError

PERIOD = 0.1
OPTIONS = SightOptions(pans=(0.0,), tilts=(0.0,), moved_m=0.05, fresh_s=0.3)
POSES = Poses((-1.0, 0.0, 1.0), (-0.5, 0.0))


def record_of(shown, on_course, pos=None, too_late=None) -> Record:
    """One world with one slot: poses (steps, npose) that show it, and whether it is on the course."""
    shown, on_course = np.array(shown, dtype=bool), np.array(on_course, dtype=bool)
    steps, poses = shown.shape
    bits = np.zeros((steps, 32), dtype=np.uint8)
    bits[:, :poses] = shown
    words = np.packbits(bits, axis=1, bitorder="little").view(np.uint32)
    pos = np.zeros((steps, 3), dtype=np.float32) if pos is None else np.array(pos, dtype=np.float32)
    late = np.zeros(steps, dtype=bool) if too_late is None else np.array(too_late, dtype=bool)
    running = np.ones((steps, 1), dtype=bool)
    return Record(running, *(values[:, None, None] for values in (pos, words, on_course, late)))


def random_events(seed, count=40, steps=25, worlds=12) -> judge.Events:
    rng = np.random.default_rng(seed)
    world = np.sort(rng.integers(0, worlds, count))
    step = rng.integers(3, steps, count)
    shows = rng.random((count, steps, len(POSES))) < 0.06
    shows &= np.arange(steps)[None, :, None] <= step[:, None, None]
    return judge.Events(world, step, shows, worlds)


@pytest.mark.parametrize(
    ("shown_at", "moves_at", "seen"),
    [
        (0, None, True),  # long ago, and it stood still
        (5, None, True),  # at the moment when it counted
        (6, None, False),  # a step too late
        (None, None, False),
        (1, 4, False),  # it has moved since
        (3, 4, True),  # it moved, but was seen just before
        (2, 4, True),
        (4, 2, True),  # it moved before it was seen
    ],
)
def test_what_was_seen_counts_while_it_is_known(shown_at, moves_at, seen):
    steps = 8
    shown = np.zeros((steps, 2), dtype=bool)
    if shown_at is not None:
        shown[shown_at, 1] = True
    pos = np.zeros((steps, 3))
    if moves_at is not None:
        pos[moves_at:, 0] = 0.2
    events = judge.find_events(record_of(shown, np.arange(steps) >= 5, pos), 2, OPTIONS, PERIOD)
    assert events.step.tolist() == [5] and events.world.tolist() == [0]
    assert judge.held(events).tolist() == [[False, seen]]
    assert judge.anywhere(events).tolist() == [seen]


@pytest.mark.parametrize(
    ("too_late", "counted"),
    [
        ([0, 0, 0, 0, 0, 0, 1, 1], 5),
        ([0, 0, 0, 1, 1, 1, 1, 1], 2),
        ([0, 1, 0, 0, 1, 1, 1, 0], 3),  # what moves may let a base pass that stops early
        ([1] * 8, 0),
    ],
)
def test_it_counts_while_braking_helps(too_late, counted):
    record = record_of(np.zeros((8, 2)), np.arange(8) >= 5, too_late=too_late)
    assert judge.find_events(record, 2, OPTIONS, PERIOD).step.tolist() == [counted]


def test_what_never_lies_on_the_course_is_not_decisive():
    events = judge.find_events(record_of(np.zeros((4, 2)), np.zeros(4)), 2, OPTIONS, PERIOD)
    assert len(events.world) == 0 and events.failed(judge.held(events)).tolist() == [[False, False]]


def test_an_episode_fails_by_one_unseen_obstacle():
    events = judge.Events(np.array([0, 0, 2]), np.zeros(3, dtype=int), np.zeros((3, 1, 1), dtype=bool), 4)
    assert events.failed(np.array([True, False, True])).tolist() == [True, False, False, False]
    assert events.failed(np.ones((3, 5), dtype=bool)).sum() == 0


def test_a_camera_that_looks_around_needs_time_to_go_there():
    """Pose 0 shows the first obstacle at step 0, pose 1 the second one at one step alone."""
    travel = np.array([[0, 3], [3, 0]])
    for step, seen in ((2, False), (3, True), (6, True)):
        shows = np.zeros((2, 8, 2), dtype=bool)
        shows[0, 0, 0], shows[1, step, 1] = True, True
        events = judge.Events(np.zeros(2, dtype=int), np.array([0, step]), shows, 1)
        assert judge.look_around(events, travel, 0).tolist() == [True, seen]
        assert judge.held(events).tolist() == [[True, False], [False, True]]


@pytest.mark.parametrize("seed", range(4))
def test_looking_around_is_between_a_held_camera_and_all_poses_at_once(seed):
    events = random_events(seed)
    still = np.full((len(POSES),) * 2, 1000)
    np.fill_diagonal(still, 0)
    assert (judge.look_around(events, still, 2) == judge.held(events)[:, 2]).all()
    travel = np.ceil(POSES.travel_s(robot.SPEED_PROFILES["paper"]) / PERIOD).astype(int)
    around = judge.look_around(events, travel, 2)
    assert (around <= judge.anywhere(events)).all() and around.sum() > judge.held(events)[:, 2].sum()
    alone = judge.of_worlds(events, np.array([3, 5]))
    rows = np.isin(events.world, (3, 5))
    assert (judge.look_around(alone, travel, 2) == around[rows]).all()


@pytest.mark.parametrize("seed", range(3))
def test_to_and_fro_is_the_best_pair_of_all(seed):
    """Against every pair simulated step by step."""
    events = random_events(seed, count=25)
    travel = np.ceil(POSES.travel_s(robot.SPEED_PROFILES["paper"]) / PERIOD).astype(int)
    seen, pair = judge.to_and_fro(events, travel, PERIOD)

    def simulate(one, two):
        result = np.zeros(len(events.world), dtype=bool)
        step = 0
        while step < events.shows.shape[1]:
            for pose, other in ((one, two), (two, one)):
                for at in range(step, min(step + 3, events.shows.shape[1])):
                    result |= events.shows[:, at, pose]
                step += 3 + travel[pose, other]
        return result

    failed = {
        (one, two): events.failed(simulate(one, two)).mean()
        for one in range(len(POSES))
        for two in range(len(POSES))
    }
    assert failed[pair] == min(failed.values())
    assert (simulate(*pair) == seen).all()


def test_episodes_of_several_records_are_put_side_by_side():
    one, two = random_events(0), random_events(1, steps=40, worlds=5)
    both = judge.join([one, two])
    assert both.worlds == 17 and both.shows.shape[1] == 40
    first = judge.of_worlds(both, np.arange(12))
    assert (first.world == one.world).all() and (judge.held(first) == judge.held(one)).all()
    second = judge.of_worlds(both, np.arange(12, 17))
    assert (second.world == two.world).all() and (second.shows == two.shows).all()


def test_the_head_takes_as_long_as_its_servos():
    """Against the law of the servos, step by step."""
    profile = robot.SPEED_PROFILES["paper"]
    poses = Poses((-3.14, -1.57, -0.2, 0.0), (-1.4, 0.3))
    speed = np.array(profile.joint_velocity_max[6:])
    h, there = 0.001, np.deg2rad(5.0)
    for i, start in enumerate(poses.table):
        for j, goal in enumerate(poses.table):
            at, time = start.copy(), 0.0
            while np.abs(goal - at).max() > there:
                rate = (goal - at) * (1.0 - np.exp(-h / profile.joint_time_constant)) / h
                at += h * np.clip(rate, -speed, speed)
                time += h
            assert poses.travel_s(profile)[i, j] == pytest.approx(time, abs=0.005)


def test_a_base_goes_on_along_its_arc():
    pose = torch.tensor([[1.0, 2.0, 0.7], [0.0, 0.0, 0.0], [0.5, -1.0, -2.0]], dtype=torch.float64)
    forward, turn = torch.tensor([0.6, -0.4, 0.0]), torch.tensor([1.2, 0.0, 0.8])
    velocity = torch.stack((forward * pose[:, 2].cos(), forward * pose[:, 2].sin(), turn), -1)
    at = pose.clone()
    for _ in range(10_000):
        at[:, 0] += 1e-4 * forward * at[:, 2].cos()
        at[:, 1] += 1e-4 * forward * at[:, 2].sin()
        at[:, 2] += 1e-4 * turn
    torch.testing.assert_close(going_on(pose, velocity, 1.0), at, atol=1e-4, rtol=0.0)


def test_a_base_that_brakes_comes_to_a_stop():
    velocity = torch.tensor([[0.6, 0.0, 0.3], [0.0, -0.8, 0.0], [0.0, 0.0, 0.0]], dtype=torch.float64)
    time = braked_time(velocity, 2.0)
    way = torch.stack([time(after) for after in np.arange(0.0, 3.0, 0.01)])
    speed = velocity[:, :2].norm(dim=-1)
    torch.testing.assert_close(way[:35] * speed, torch.arange(35)[:, None] * 0.01 * speed)
    torch.testing.assert_close(way[-1] * speed, 0.35 * speed + speed**2 / 4.0)  # v^2 / 2 a
    slows = (way * speed).diff(dim=0).diff(dim=0)[40:60] / 0.01**2  # while both brake
    torch.testing.assert_close(slows[:, :2], torch.full_like(slows[:, :2], -2.0))


@pytest.mark.parametrize(
    ("pans", "tilts", "message"),
    [
        ((-4.0, 0.0), (0.0,), "sight.pans"),
        ((0.5, 0.0), (0.0,), "sight.pans"),
        ((0.0,), (), "sight.tilts"),
        ((0.0,), (0.0, 0.9), "sight.tilts"),
    ],
)
def test_impossible_poses_are_refused(pans, tilts, message):
    with pytest.raises(ConfigError, match=message):
        Poses(pans, tilts)
