"""When a drive ends and how: the end of a step by tables of what it left behind."""

from dataclasses import replace

import numpy as np
import pytest
from nav_steps import BEFORE_M, LIMIT, Left, end_step

from spin_rl.tasks.common.episode import COLLISION, NON_FINITE, RUNNING, SUCCESS, TIMEOUT

AT_GOAL = (0.2, -0.2)
CASES = [
    (Left(), RUNNING),
    (Left(way=AT_GOAL), SUCCESS),
    (Left(way=(0.0, 0.31)), RUNNING),
    (Left(part="base"), COLLISION),
    (Left(part="head"), COLLISION),
    (Left(length=LIMIT - 2), RUNNING),
    (Left(length=LIMIT - 1), TIMEOUT),
    # Who touches something in the step in which it arrives has not succeeded; who arrives in the last has.
    (Left(way=AT_GOAL, part="arm"), COLLISION),
    (Left(way=AT_GOAL, length=LIMIT - 1), SUCCESS),
    (Left(part="gripper", length=LIMIT - 1), COLLISION),
    (Left(way=AT_GOAL, part="arm", length=LIMIT - 1), COLLISION),
    (Left(way=AT_GOAL, part="base", length=LIMIT - 1, broken="qpos"), NON_FINITE),
    (Left(way=AT_GOAL, broken="qvel"), NON_FINITE),
    (Left(broken="action"), NON_FINITE),
]
LEVELS = {RUNNING: 0.5, SUCCESS: 0.6}


def test_outcome_and_level(device):
    ended = end_step([left for left, _ in CASES], device)
    assert ended["outcome"].tolist() == [wanted for _, wanted in CASES]
    np.testing.assert_allclose(ended["level"], [LEVELS.get(wanted, 0.45) for _, wanted in CASES])


def test_without_a_stop_collisions_end_nothing(device):
    """The same steps, had nothing been touched."""
    lefts = [left for left, _ in CASES]
    untouched = end_step([replace(left, part=None) for left in lefts], device)
    for name, ours in end_step(lefts, device, stop_on_collision=False).items():
        np.testing.assert_array_equal(ours, untouched[name], err_msg=name)


@pytest.mark.parametrize(("bend", "to_go"), [(0, 1.0), (1, 1.4)])
def test_progress_is_of_the_way_through_the_corridor(device, bend, to_go):
    """0.6 and 0.8 m to go: 1 m straight, 1.4 m along two legs."""
    ended = end_step([Left(way=(0.6, -0.8), bend=bend)], device)
    assert ended["straight"] == pytest.approx(1.0)
    assert ended["distance"] == pytest.approx(to_go)  # for the next step's progress
    assert ended["progress"] == pytest.approx(BEFORE_M - to_go)
