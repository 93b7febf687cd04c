"""What larger places cost: training and the parts of a step, in corridors, families and example scenes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import warp as wp

from spin_rl.benchmark.scenes import example_scenes
from spin_rl.sim.graph import StepGraph
from spin_rl.speed.env import RandomDriver
from spin_rl.speed.rows import Row, cost_row, rate_row
from spin_rl.speed.timing import Stopwatch, Subject, interleave
from spin_rl.speed.train import Learner
from spin_rl.tasks.common.compose import compose
from spin_rl.tasks.nav.env import NavEnv
from spin_rl.tasks.nav.spec import NAV

CORRIDOR = "corridor"
"""Name of what the others are compared with."""
_EXAMPLES = ("office", "cafe")
"""The example scenes with most things."""
_UNIT = "us an env step"


def make_places(overrides: Sequence[str], num_envs: int, device: str, seed: int) -> dict[str, NavEnv]:
    """Start environments of all places, with depth images; overrides are those of the benchmark's command."""
    given = [o for o in overrides if not o.startswith(("scene=", "what="))]
    scenes = example_scenes()

    def env(scene: str, name: str | None = None) -> NavEnv:
        values = compose("bench", [*given, f"scene={scene}", "task.depth.enabled=true"])
        fixed = None if name is None else [scenes[name]] * num_envs
        return NavEnv(NAV.configure(values), num_envs, device, seed=seed, scene=fixed)

    places = {CORRIDOR: env("nav"), "mixture": env("mixture")}
    return places | {name: env("nav", name) for name in _EXAMPLES}


def measure_places(
    places: dict[str, NavEnv], runner: dict[str, Any], seconds: float, seed: int, watch: Stopwatch
) -> list[Row]:
    """Time training and the parts of a step in several places, all in turns.

    Args:
        places: Environments with a depth camera, by name; `CORRIDOR` is what the others are compared with.
        runner: Section `runner` of the configuration.
        seconds: Time to measure for, half of it for training.
        seed: Of the random actions that bring the robots to where the parts are measured.
        watch: Waits for the device.

    Returns:
        Full training in the mixture, in env steps per second; then the cost of every part in every place.
    """
    rows = _training(places, runner, 0.5 * seconds, watch)
    for env in places.values():
        RandomDriver(env, seed, warm_up_steps=20)
    for part in ("physics", "nearby", "scandots", "depth"):
        subjects = {}
        for name, env in places.items():
            launch = _parts(env)[part]
            if launch is not None:
                graph = StepGraph(launch, env.device)
                subjects[name] = Subject(lambda n, g=graph: watch.time(g.replay, n), env.num_envs)
        times = interleave(subjects, 0.5 * seconds / 4)
        for name, timing in times.items():
            things = int(wp.to_torch(places[name].sim.layout.active).sum(1).float().mean())
            peer = times.get(CORRIDOR) if name != CORRIDOR else None
            label = None if peer is None else CORRIDOR
            rows.append(cost_row(f"{part}, {name}, {things} things", timing, _UNIT, label, peer))
    return rows


def _training(
    places: dict[str, NavEnv], runner: dict[str, Any], seconds: float, watch: Stopwatch
) -> list[Row]:
    """Full training in corridors and in the mixture, without the images that it does not read."""
    subjects = {}
    for name in (CORRIDOR, "mixture"):
        place = places[name]
        env = NavEnv(replace(place.cfg, depth=None), place.num_envs, place.device, seed=1)
        learner = Learner(env, runner)
        work = runner["num_steps_per_env"] * env.num_envs
        subjects[name] = Subject(lambda n, step=learner.iterate: watch.time(step, n), work)
    times = interleave(subjects, seconds)
    unit = "env steps/s"
    return [
        rate_row(f"training, {CORRIDOR}", times[CORRIDOR], unit),
        rate_row("training, mixture", times["mixture"], unit, f"training, {CORRIDOR}", times[CORRIDOR]),
    ]


def _parts(env: NavEnv) -> dict[str, Callable[[], None] | None]:
    assert env.depth is not None
    return {
        "physics": env.sim.advance,
        "nearby": env.sim.nearby.update if env.sim.nearby else None,
        "scandots": env.scandots.update,
        "depth": env.depth.update,
    }
