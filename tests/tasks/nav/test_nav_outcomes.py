"""When a drive ends and how: the end of a step by tables of what it left behind."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import warp as wp

from spin_rl import robot
from spin_rl.tasks.common.episode import COLLISION, NON_FINITE, RUNNING, SUCCESS, TIMEOUT, StepEnd
from spin_rl.tasks.nav.episode import NavRules, end_episodes
from spin_rl.tasks.nav.ways import Ways

TOLERANCE, LIMIT = 0.3, 100
UP, DOWN = 0.1, 0.05


@dataclass
class Left:
    """What a step leaves behind: way to the goal along x and y [m], a part that touches, steps so far."""

    way: tuple[float, float] = (2.0, 0.0)
    part: str | None = None
    length: int = 10
    broken: str | None = None
    bend: int = 0


def end(lefts, device, *, stop_on_collision=True):
    """End one step, a world for each; return outcomes, levels (0.5 before), progress and distance."""
    n, dofs = len(lefts), len(robot.DOF_NAMES)
    state = {
        "qpos": np.zeros((n, dofs), np.float32),
        "qvel": np.zeros((n, dofs), np.float32),
        "action": np.zeros((n, len(robot.ACTIONS)), np.float32),
    }
    for world, left in enumerate(lefts):
        if left.broken is not None:
            state[left.broken][world, 4] = np.nan
    rules, ways, ended = NavRules(), Ways(), StepEnd()
    rules.goal_tolerance_m, rules.stop_on_collision = TOLERANCE, stop_on_collision
    rules.level_up, rules.level_down = UP, DOWN
    with wp.ScopedDevice(device):
        progress, distance, level = (wp.full(n, value, dtype=float) for value in (0.0, 3.0, 0.5))
        outcome, done = wp.zeros(n, dtype=wp.int32), wp.zeros(n, dtype=bool)
        straight = wp.zeros(n, dtype=float)
        qpos, qvel, action = (wp.array(array) for array in state.values())
        ways.bend = wp.array([left.bend for left in lefts], dtype=wp.int32)
        ways.field.values = wp.zeros((0, 0, 0), dtype=float)
        ways.most_steps = wp.full(n, LIMIT, dtype=wp.int32)
        ended.qpos, ended.qvel = wp.zeros_like(qpos), wp.zeros_like(qvel)
        ended.outcome, ended.done = outcome, done
        wp.launch(
            end_episodes,
            dim=n,
            inputs=[
                qpos,
                qvel,
                action,
                wp.array([left.way for left in lefts], dtype=wp.vec2),
                wp.array([[part == left.part for part in robot.PARTS] for left in lefts], dtype=bool),
                rules,
                ways,
                wp.array([left.length for left in lefts], dtype=wp.int32),
                distance,
                level,
            ],
            outputs=[progress, straight, ended],
        )
    assert (done.numpy() == (outcome.numpy() != RUNNING)).all()
    return outcome.numpy().tolist(), level.numpy(), progress.numpy(), straight.numpy()


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
    outcome, level, *_ = end([left for left, _ in CASES], device)
    assert outcome == [wanted for _, wanted in CASES]
    np.testing.assert_allclose(level, [LEVELS.get(wanted, 0.45) for _, wanted in CASES])


def test_without_a_stop_collisions_end_nothing(device):
    """The same steps, had nothing been touched."""
    lefts = [left for left, _ in CASES]
    untouched = end([replace(left, part=None) for left in lefts], device)
    for ours, theirs in zip(end(lefts, device, stop_on_collision=False), untouched, strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize(("bend", "to_go"), [(0, 1.0), (1, 1.4)])
def test_progress_is_of_the_way_through_the_corridor(device, bend, to_go):
    """0.6 and 0.8 m to go: 1 m straight, 1.4 m along two legs; 3 m before the step."""
    _, _, progress, straight = end([Left(way=(0.6, -0.8), bend=bend)], device)
    assert straight == pytest.approx(1.0) and progress == pytest.approx(3.0 - to_go)
