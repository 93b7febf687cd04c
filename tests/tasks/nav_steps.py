"""The end of a drive's control step on plain arrays: what it left behind, and what is made of that."""

from dataclasses import dataclass

import numpy as np
import warp as wp

from spin_rl import robot
from spin_rl.scenes.layout import Layout, PoolSpec
from spin_rl.tasks.common.episode import RUNNING, StepEnd
from spin_rl.tasks.nav.episode import NavRules, end_episodes, make_trips
from spin_rl.tasks.nav.ways import corridor_ways

TOLERANCE, LIMIT = 0.3, 100
UP, DOWN = 0.1, 0.05
BEFORE_M, LEVEL = 3.0, 0.5
"""How far it was to the goal, and the level, before the step."""


@dataclass
class Left:
    """What a step leaves behind: way to the goal along x and y [m], a part that touches, steps so far."""

    way: tuple[float, float] = (2.0, 0.0)
    part: str | None = None
    length: int = 10
    broken: str | None = None
    bend: int = 0


def end_step(lefts, device, *, stop_on_collision=True, ways=None) -> dict[str, np.ndarray]:
    """End one step, a world for each: outcome, level, progress, distance to go and straight distance."""
    n, dofs = len(lefts), len(robot.DOF_NAMES)
    state = {
        "qpos": np.zeros((n, dofs), np.float32),
        "qvel": np.zeros((n, dofs), np.float32),
        "action": np.zeros((n, len(robot.ACTIONS)), np.float32),
    }
    for world, left in enumerate(lefts):
        if left.broken is not None:
            state[left.broken][world, 4] = np.nan
    rules, ended = NavRules(), StepEnd()
    rules.goal_tolerance_m, rules.stop_on_collision = TOLERANCE, stop_on_collision
    rules.level_up, rules.level_down = UP, DOWN
    with wp.ScopedDevice(device):
        progress, distance, level = (wp.full(n, value, dtype=float) for value in (0.0, BEFORE_M, LEVEL))
        outcome, done = wp.zeros(n, dtype=wp.int32), wp.zeros(n, dtype=bool)
        straight = wp.zeros(n, dtype=float)
        qpos, qvel, action = (wp.array(array) for array in state.values())
        ended.qpos, ended.qvel = wp.zeros_like(qpos), wp.zeros_like(qvel)
        ended.outcome, ended.done = outcome, done
        goal = wp.array([left.way for left in lefts], dtype=wp.vec2)
        wp.launch(
            end_episodes,
            dim=n,
            inputs=[
                qpos,
                qvel,
                action,
                goal,
                wp.array([[part == left.part for part in robot.PARTS] for left in lefts], dtype=bool),
                rules,
                ways or corridors(lefts, device),
                wp.array([left.length for left in lefts], dtype=wp.int32),
                goal,
                distance,
                level,
                make_trips(n, device),
            ],
            outputs=[progress, straight, ended],
        )
    assert (done.numpy() == (outcome.numpy() != RUNNING)).all()
    arrays = {"outcome": outcome, "level": level, "progress": progress, "distance": distance}
    return {name: array.numpy() for name, array in (arrays | {"straight": straight}).items()}


def corridors(lefts, device):
    """Ways through corridors, in as many worlds, with one time limit."""
    layout = Layout(len(lefts), PoolSpec(1, 0, 0), device)
    layout.bend.assign([left.bend for left in lefts])
    return corridor_ways(layout, LIMIT)
