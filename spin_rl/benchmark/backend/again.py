"""A benchmark's episodes again in another simulator: the exported policy, the deploy loop, C MuJoCo.

The batched run gives scenes and outcomes; every episode is then run once more, by itself, and paired with it.
"""

from __future__ import annotations

import functools
import multiprocessing
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from spin_rl.benchmark.backend.conditions import Config, check
from spin_rl.benchmark.backend.recorder import Recorder, Start
from spin_rl.benchmark.backend.umpires import DriveUmpire, FetchUmpire, PickUmpire, Umpire
from spin_rl.benchmark.fetch import Fetches, summarize_fetches
from spin_rl.benchmark.metrics import (
    DriveEpisodes,
    Episodes,
    PickEpisodes,
    paired_difference,
    summarize_drives,
    summarize_picks,
)
from spin_rl.benchmark.rounds import Report
from spin_rl.benchmark.tables.backend import MUJOCO
from spin_rl.deploy.agent import Agent
from spin_rl.deploy.backends.mujoco import TIMESTEP_S, MujocoRobot
from spin_rl.deploy.backends.renderers import RAYS
from spin_rl.deploy.fetch import stages
from spin_rl.deploy.fetch.agent import FetchAgent, open_agent
from spin_rl.deploy.loop import ARRIVED, TIME_OVER, ControlLoop
from spin_rl.scenes.objects.shapes import OBJECTS
from spin_rl.tasks.common import episode
from spin_rl.tasks.fetch.config import FetchConfig
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.pick import episode as pick_episode
from spin_rl.tasks.pick.config import PickConfig

_KINDS: Mapping[type, tuple[Any, Callable[[Any, float], dict[str, Any]]]] = {
    NavConfig: (DriveEpisodes, summarize_drives),
    PickConfig: (PickEpisodes, summarize_picks),
    FetchConfig: (Fetches, summarize_fetches),
}
"""Of every task the class that holds its episodes, and what sums them up."""
_RUNSTOP = "runstop"
_OUTCOMES: Mapping[str, Any] = {
    ARRIVED: episode.SUCCESS,
    stages.PLACED: episode.SUCCESS,
    stages.HIT: episode.COLLISION,
    stages.DROPPED: int(pick_episode.DROPPED),
    **dict.fromkeys((TIME_OVER, *stages.NO_TIME.values()), episode.TIMEOUT),
    **dict.fromkeys(("the robot's state is not finite", "the action is not finite"), episode.NON_FINITE),
}
"""Outcomes by the reasons of the control loop; the runstop is pressed by the umpire, who knows why."""
_SECONDS_BETWEEN_REPORTS = 5.0


def evaluate_again(
    evaluate: Callable[..., dict[str, Any]],
    cfg: Config,
    path: Path,
    *,
    backend: str = MUJOCO,
    renderer: str = RAYS,
    processes: int = 1,
    report: Report = print,
) -> dict[str, Any]:
    """Run a benchmark batched, and each of its episodes by an exported policy in another simulator.

    Args:
        evaluate: Runs the batched benchmark; takes `watch` and returns its result.
        cfg: Task configuration of both.
        path: The same policy as an exported file, or the folder of a fetch.
        backend: One of `tables.backend.BACKENDS`.
        renderer: What makes depth images, one of `renderers.RENDERERS`.
        processes: How many run episodes at the same time.
        report: Receives lines of progress.

    Returns:
        The result of `evaluate`, but that `rows` and `overall` are of the other simulator. Each has its row
        of the batched run as `batched` (`overall` its success rate alone), and `difference`: success there
        minus batched, see `metrics.paired_difference`. So have the `objects` of a fetch. Further `backend`,
        `renderer`, `timestep_s` and `backend_seconds`.

    Raises:
        ConfigError: The file does not fit the task.
    """
    check(open_agent(path), cfg)
    recorder = Recorder()
    result = evaluate(watch=recorder)
    start_s = time.monotonic()
    run = functools.partial(run_episode, path=path, cfg=cfg, renderer=renderer)
    rows = list(_with_progress(_map(run, recorder.starts, processes), len(recorder.starts), report))
    return result | {
        **_pair(rows, recorder.starts, recorder.ends, cfg, result),
        "backend": backend,
        "renderer": renderer,
        "timestep_s": TIMESTEP_S,
        "backend_seconds": round(time.monotonic() - start_s, 2),
    }


def _pair(
    rows: Sequence[Mapping[str, Any]],
    starts: Sequence[Start],
    ends: Sequence[Episodes],
    cfg: Config,
    batched: Mapping[str, Any],
) -> dict[str, Any]:
    """Sum episodes up beside the batched ones: `rows`, `objects` of a fetch, and `overall`."""
    kind, summarize = _KINDS[type(cfg)]
    ours: Any = kind(**{name: np.array([row[name] for row in rows]) for name in rows[0]})
    theirs, period = Episodes.concatenate(ends), cfg.sim.control_period

    def told(chosen: np.ndarray, there: Mapping[str, Any]) -> dict[str, Any]:
        row = summarize(ours.select(chosen), period)
        difference = paired_difference([theirs.select(chosen)], [ours.select(chosen)])
        return {**there, **row, "batched": {key: there[key] for key in row}, "difference": difference}

    # Benchmarks give the worlds of a seed their conditions in turn.
    conditions = len(batched["rows"])
    condition = np.concatenate([np.arange(len(end.outcome)) % conditions for end in ends])
    paired = {"rows": [told(condition == index, row) for index, row in enumerate(batched["rows"])]}
    if "objects" in batched:
        thing = np.array([None if start.thing is None else start.thing.kind for start in starts])
        paired["objects"] = [told(thing == row["object"], row) for row in batched["objects"]]
    overall = summarize(ours, period) | {
        "batched": {"success_rate": float((theirs.outcome == episode.SUCCESS).mean())},
        "difference": paired_difference([theirs], [ours]),
    }
    return {**paired, "overall": overall}


@functools.cache
def _agent(path: Path) -> Agent | FetchAgent:
    """Of this process; an episode leaves nothing behind in it."""
    return open_agent(path)


def run_episode(start: Start, *, path: Path, cfg: Config, renderer: str = RAYS) -> Mapping[str, Any]:
    """Run one episode in C MuJoCo, in simulated time; return what the task's `Episodes` hold of it."""
    agent = _agent(path)
    thing = None
    if start.thing is not None:
        # The table is the first box of a scene of the pick task.
        table = cfg.scene.table_slot if isinstance(cfg, FetchConfig) else start.scene.pool.first_box
        thing = start.thing, table
    one = MujocoRobot(start.scene, agent.contract, renderer=renderer, thing=thing)
    umpire = one.umpire = _umpire(one, start, cfg, agent)
    connection = one.connect()
    # Who fetches must find the object.
    is_told = connection.object_b is not None and isinstance(agent, Agent)
    object_b = np.array(connection.object_b) if is_told else None
    # The goal may be reached with the last step; whether it was is seen at the next tick.
    most_s = (start.most_steps + 0.5) * agent.contract.period_s
    ended = ControlLoop(one, connection, agent).run(most_s, start.scene.goal, object_b)
    if ended.reason.startswith("SIG"):
        raise KeyboardInterrupt
    return {
        "outcome": umpire.outcome if ended.reason == _RUNSTOP else _OUTCOMES[ended.reason],
        "steps": min(ended.steps, start.most_steps),
        **umpire.figures(one.data),
    }


def _umpire(one: MujocoRobot, start: Start, cfg: Config, agent: Agent | FetchAgent) -> Umpire:
    if isinstance(cfg, NavConfig):
        return DriveUmpire(one.model, one.data, start.scene.goal, start.way)
    assert one.handled is not None and start.thing is not None
    if isinstance(cfg, PickConfig):
        return PickUmpire(one.model, one.handled, float(start.thing.half_extents[2]), cfg)
    assert isinstance(agent, FetchAgent)
    return FetchUmpire(one.model, one.handled, agent, OBJECTS.index(start.thing.kind))


def _map(
    run: Callable[[Start], Mapping[str, Any]], starts: Sequence[Start], processes: int
) -> Iterator[Mapping[str, Any]]:
    if processes == 1:
        yield from map(run, starts)
        return
    # A forked process would have this one's threads without their state.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, context) as pool:
        yield from pool.map(run, starts)


def _with_progress(
    rows: Iterator[Mapping[str, Any]], total: int, report: Report
) -> Iterator[Mapping[str, Any]]:
    begin = last = time.monotonic()
    for done, row in enumerate(rows, start=1):
        yield row
        now = time.monotonic()
        if now - last >= _SECONDS_BETWEEN_REPORTS or done == total:
            last = now
            report(f"  C MuJoCo: {done} of {total} episodes after {now - begin:.0f} s")
