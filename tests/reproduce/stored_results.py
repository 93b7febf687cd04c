"""Results as spin-reproduce stores them, of figures that a test chooses."""

import json

from spin_rl.reproduce import state
from spin_rl.reproduce.plan import Evaluation
from spin_rl.scenes.kinds import DIFFICULTIES, SCENARIOS

EPISODES = 100
MACHINE = {"hardware": "a machine", "commit": "abc"}


def training(steps, name):
    """What a result tells of a training."""
    step = steps.by_name[name]
    return state.planned(step) | {
        "env_steps": step.env_steps + 100,
        "minutes": 9.0,
        "success_rate": 0.5,
        "processes": 2,
        "commits": ["abc"],
        "hardware": "a machine",
        "curve": {
            "env_steps": [1e6, 2e6, 4e6, 8e6],
            "success_rate": [0.1, 0.3, 0.6, 0.8],
            "level": [0, 0, 1, 1],
        },
        "needs": [training(steps, other) for other in steps.needs(step)],
    }


def rows_of(kind, success):
    """Rows of the result of a benchmark, by how many of a hundred episodes succeed in a cell."""
    if kind == "speed":
        return [{"name": "env step with depth images", "value": 900.0, "baseline_value": 1800.0}]
    cells = [(scenario, difficulty) for scenario in SCENARIOS for difficulty in DIFFICULTIES]
    keys = ("scenario", "difficulty")
    if kind == "dynamic":
        cells = [(scene, obstacles) for scene in ("lab", "study") for obstacles in ("static", "dynamic")]
        keys = ("scene", "obstacles")
    return [
        dict(zip(keys, cell, strict=True))
        | {
            "success_rate": success(cell) / EPISODES,
            "ci95": [0.0, 1.0],
            "episodes": EPISODES,
            "duration_s": 7.0 if success(cell) else None,
            "final_distance_m": 0.3,
            "final_distance_ci95": [0.2, 0.4],
            "timeout_rate": 0.01,
            "collisions": 1.5,
            "collisions_ci95": [1.2, 1.8],
            "reach": {"succeeded": EPISODES},
            "pick": {"succeeded": 90, "duration_s": 5.0},
            "place": {"succeeded": success(cell), "duration_s": 9.0 if success(cell) else None},
            "outcomes": "s" * success(cell) + "c" * (EPISODES - success(cell)),
        }
        for cell in cells
    ]


def stored_result(steps, step, success):
    """What is stored of a step; `success`: how many of a hundred episodes succeed in a cell."""
    return MACHINE | {
        "command": state.command_of(steps, step),
        "step": state.planned(step),
        "minutes": 2.0,
        "trainings": [training(steps, name) for name in steps.needs(step)],
        "result": {
            "rows": rows_of(step.name.partition("/")[0], success),
            "seeds": [0, 1, 2],
            "num_envs": 200,
            "commit": "abc",
            "pick": "pick-teacher",
            "overall": {"pick": {"succeeded": 300, "tried": 400}},
        },
    }


def store(steps, name, success=lambda cell: 50):
    """Store a result of a step, see `stored_result`."""
    file = state.result_file(name)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(stored_result(steps, steps.by_name[name], success)))


def store_all(steps, success):
    """Store a result of every evaluation of a plan.

    Args:
        steps: The plan.
        success: Successes of a hundred episodes, of the step's name and the cell.
    """
    for name, step in steps.by_name.items():
        if isinstance(step, Evaluation):
            store(steps, name, lambda cell, name=name: success(name, cell))
