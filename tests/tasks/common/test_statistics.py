"""Sums over episodes: every episode counts with its own length and return."""

import math
from types import SimpleNamespace

import pytest
import torch

from spin_rl.tasks.common.episode import COLLISION, RUNNING, SUCCESS, TIMEOUT
from spin_rl.tasks.common.statistics import EpisodeStatistics

PERIOD = 0.1


def add(statistics, outcomes, rewards):
    """One control step of two worlds."""
    env = SimpleNamespace(
        sim=SimpleNamespace(config=SimpleNamespace(control_period=PERIOD)),
        outcome=torch.tensor(outcomes, dtype=torch.int32),
    )
    reward = torch.tensor(rewards)
    statistics.add(env, reward, {"all": reward})


@pytest.fixture
def statistics():
    return EpisodeStatistics(2, ("all",), "cpu")


def test_episodes_in_a_row_have_lengths_and_returns_of_their_own(statistics):
    """World 0: episodes of 2, 1 and 3 steps, returns 3, 5 and 6; world 1's goes on."""
    steps = [
        (RUNNING, 1.0), (SUCCESS, 2.0), (COLLISION, 5.0), (RUNNING, 1.0), (RUNNING, 2.0), (TIMEOUT, 3.0),
    ]  # fmt: skip
    for outcome, reward in steps:
        add(statistics, [outcome, RUNNING], [reward, 100.0])
    stats = statistics.read()
    assert stats["episodes"] == 3
    assert stats["success_rate"] == stats["collision_rate"] == stats["timeout_rate"] == pytest.approx(1 / 3)
    assert stats["mean_length_s"] == pytest.approx(PERIOD * (2 + 1 + 3) / 3)
    assert stats["mean_return"] == pytest.approx((3.0 + 5.0 + 6.0) / 3)
    assert stats["reward/all"] == pytest.approx((14.0 + 600.0) / 12)
    # What goes on is counted where it ends, whatever was read in between.
    add(statistics, [RUNNING, SUCCESS], [0.0, 1.0])
    stats = statistics.read()
    assert stats["episodes"] == stats["success_rate"] == 1.0
    assert stats["mean_length_s"] == pytest.approx(7 * PERIOD) and stats["mean_return"] == 601.0


def test_a_restart_forgets_what_runs_and_keeps_what_has_ended(statistics):
    add(statistics, [SUCCESS, RUNNING], [4.0, 100.0])
    add(statistics, [RUNNING, RUNNING], [100.0, 100.0])
    statistics.restart()
    add(statistics, [RUNNING, SUCCESS], [1.0, 2.0])
    add(statistics, [SUCCESS, RUNNING], [1.0, 2.0])
    stats = statistics.read()
    assert stats["episodes"] == 3
    assert stats["mean_return"] == pytest.approx((4.0 + 2.0 + 2.0) / 3)
    assert stats["mean_length_s"] == pytest.approx(PERIOD * (1 + 1 + 2) / 3)


def test_a_restart_of_some_worlds_leaves_the_others(statistics):
    add(statistics, [RUNNING, RUNNING], [10.0, 20.0])
    statistics.restart(torch.tensor([True, False]))
    add(statistics, [SUCCESS, SUCCESS], [1.0, 2.0])
    stats = statistics.read()
    assert stats["mean_return"] == pytest.approx((1.0 + 22.0) / 2)
    assert stats["mean_length_s"] == pytest.approx(PERIOD * (1 + 2) / 2)


def test_no_episodes_have_no_rates(statistics):
    add(statistics, [RUNNING, RUNNING], [1.0, 3.0])
    stats = statistics.read()
    assert stats["episodes"] == 0 and stats["reward/all"] == 2.0
    for name in ("success_rate", "mean_return", "mean_length_s"):
        assert math.isnan(stats[name]), name
