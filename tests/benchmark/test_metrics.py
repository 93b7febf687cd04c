import numpy as np
import pytest
from scipy import stats

from spin_rl import robot
from spin_rl.benchmark.metrics import (
    Episodes,
    PickEpisodes,
    ReachEpisodes,
    spl,
    summarize,
    summarize_picks,
    wilson_interval,
)
from spin_rl.benchmark.tables.paper import REACH
from spin_rl.tasks.common import episode
from spin_rl.tasks.pick import episode as pick_episode


@pytest.mark.parametrize(
    ("successes", "count"), [(0, 1), (1, 1), (0, 30), (30, 30), (29, 30), (7, 13), (150, 300)]
)
def test_wilson_matches_scipy(successes, count):
    expected = stats.binomtest(successes, count).proportion_ci(0.95, method="wilson")
    assert wilson_interval(successes, count) == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_wilson_ends_are_exact():
    assert wilson_interval(0, 7)[0] == 0.0
    assert wilson_interval(7, 7)[1] == 1.0


@pytest.mark.parametrize(("successes", "count"), [(0, 0), (3, 2), (-1, 2)])
def test_wilson_rejects_impossible_counts(successes, count):
    with pytest.raises(ValueError, match="no interval"):
        wilson_interval(successes, count)


def test_spl_of_detours_failures_and_a_start_at_the_goal():
    success, way = np.array([True, True, False, True]), np.array([2.0, 2.0, 2.0, 0.0])
    # A way of nothing counts 0: there was nothing to plan.
    assert spl(success, way, np.array([4.0, 1.8, 1.0, 0.3])) == pytest.approx((0.5 + 1.0) / 4)


def make_episodes(rows):
    """Rows are (outcome, steps, distance, names of touching parts)."""
    return ReachEpisodes(
        np.array([getattr(episode, row[0]) for row in rows]),
        np.array([row[1] for row in rows]),
        np.array([row[2] for row in rows]),
        np.array([[part in row[3] for part in robot.PARTS] for row in rows]),
    )


def test_summary_of_a_mixed_cell():
    episodes = make_episodes(
        [
            ("SUCCESS", 60, 0.1, ()),
            ("SUCCESS", 80, 0.1, ()),
            ("COLLISION", 20, 3.0, ("base", "arm")),
            ("COLLISION", 30, 2.0, ("arm",)),
            ("TIMEOUT", 600, 1.0, ()),
            # What touches in a world that is not finite means nothing.
            ("NON_FINITE", 10, 3.8, ("head",)),
        ]
    )
    cell = summarize(episodes, control_period=0.1)
    assert cell["success_rate"] == pytest.approx(2 / 6)
    assert cell["ci95"] == pytest.approx(wilson_interval(2, 6))
    assert cell["duration_s"] == pytest.approx(7.0)
    assert cell["duration_all_s"] == pytest.approx(80.0 / 6)
    assert cell["collision_rate"] == pytest.approx(2 / 6)
    assert cell["timeout_rate"] == pytest.approx(1 / 6)
    assert cell["non_finite"] == 1
    assert cell["final_distance_m"] == pytest.approx(10.0 / 6)
    assert cell["episodes"] == 6
    assert set(cell["causes"]) == {*robot.PARTS, "timeout", "non_finite"}
    assert {name: share for name, share in cell["causes"].items() if share} == pytest.approx(
        {"base": 0.25, "arm": 0.5, "timeout": 0.25, "non_finite": 0.25}
    )


def test_summary_without_success_or_failure():
    failed = summarize(make_episodes([("TIMEOUT", 600, 4.0, ())]), 0.1)
    assert failed["duration_s"] is None
    assert failed["duration_all_s"] == pytest.approx(60.0)
    passed = summarize(make_episodes([("SUCCESS", 50, 0.1, ())]), 0.1)
    assert passed["success_rate"] == 1.0
    assert set(passed["causes"].values()) == {0.0}


def test_paper_rows_are_complete():
    for cells in REACH.values():
        assert len(cells) == 6
    assert REACH["SPIN (CVO)"][2, "medium"].duration_s == 15.81
    assert REACH["FixCam"][1, "hard"].success_rate == 0.20


def test_summary_of_picks_tells_every_way_to_fail():
    outcomes = ["SUCCESS", "SUCCESS", "COLLISION", "TIMEOUT", "TIMEOUT", "NON_FINITE"]
    numbers = [getattr(episode, name) for name in outcomes] + [pick_episode.DROPPED] * 2
    hard = np.array([0.0, 0.2, 35.0, 0.0, 4.0, 0.0, 0.0, 0.0])
    episodes = PickEpisodes(np.array(numbers), np.arange(10, 90, 10), np.linspace(0.0, 0.7, 8), hard)
    row = summarize_picks(episodes, control_period=0.1)
    assert row["success_rate"] == pytest.approx(2 / 8) and row["episodes"] == 8
    assert row["untouched_rate"] == 1 / 8  # the first: the second touched, and the others failed
    assert row["ci95"] == pytest.approx(wilson_interval(2, 8))
    assert row["duration_s"] == pytest.approx(1.5) and row["duration_all_s"] == pytest.approx(4.5)
    assert (row["collision_rate"], row["dropped_rate"], row["timeout_rate"]) == (1 / 8, 2 / 8, 2 / 8)
    assert row["non_finite"] == 1 and row["final_distance_m"] == pytest.approx(0.35)
    shares = {"table hit": 1 / 6, "dropped": 2 / 6, "timeout": 2 / 6, "non_finite": 1 / 6}
    assert row["causes"] == pytest.approx(shares)
    both = Episodes.concatenate([episodes.select(np.arange(8) < 3), episodes.select(np.arange(8) >= 3)])
    assert isinstance(both, PickEpisodes) and summarize_picks(both, 0.1) == row
