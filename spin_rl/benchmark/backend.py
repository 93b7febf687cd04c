"""A benchmark's episodes again in another simulator: the exported policy, the deploy loop, C MuJoCo.

The batched run gives scenes and outcomes; every episode is then run once more, by itself, and paired with it.
"""

from __future__ import annotations

import functools
import multiprocessing
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict

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
from spin_rl.benchmark.umpires import DriveUmpire, PickUmpire, Umpire
from spin_rl.config import ConfigError
from spin_rl.deploy.agent import Agent
from spin_rl.deploy.backends.mujoco import TIMESTEP_S, MujocoRobot
from spin_rl.deploy.backends.renderers import RAYS
from spin_rl.deploy.contract import Contract
from spin_rl.deploy.loop import ARRIVED, TIME_OVER, ControlLoop
from spin_rl.deploy.network import Network
from spin_rl.policy import Policy
from spin_rl.scenes.layout import Scene
from spin_rl.scenes.objects.shapes import SceneObject
from spin_rl.sensors.depth.noise import DepthNoiseConfig
from spin_rl.tasks.common import episode
from spin_rl.tasks.common.env import TaskEnv
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.env import NavEnv
from spin_rl.tasks.pick.config import PickConfig

"""Those whose episodes can be run again."""
_RUNSTOP = "runstop"
_NOT_FINITE = ("the robot's state is not finite", "the action is not finite")
"""Reasons of the control loop."""
_SECONDS_BETWEEN_REPORTS = 5.0


@dataclass(frozen=True)
class Start:
    """An episode before its first step.

    Attributes:
        scene: The world, with start and goal.
        most_steps: Control steps until its time is over.
        way: Length of the way to the goal, if there is one [m].
        thing: The object to pick, if there is one.
    """

    scene: Scene
    most_steps: int
    way: float = 0.0
    thing: SceneObject | None = None


class Recorder:
    """Keeps how the episodes of a batched benchmark began and ended; its `watch` argument.

    Attributes:
        starts: In the order of worlds, seed after seed.
        ends: Likewise, a group of every seed.
    """

    def __init__(self) -> None:
        self.starts: list[Start] = []
        self.ends: list[Episodes] = []

    def __call__(self, env: TaskEnv, policy: Policy, seed: int) -> Policy:
        """Look on at the episodes of a seed."""
        return _Recorded(self, env, policy)


class _Recorded:
    """Passes a policy through; every world is one episode."""

    def __init__(self, recorder: Recorder, env: TaskEnv, policy: Policy) -> None:
        self._recorder, self._env, self._policy = recorder, env, policy

    def __call__(self, obs: TensorDict) -> torch.Tensor:
        return self._policy(obs)

    def reset(self, dones: torch.Tensor | None = None) -> None:
        self._policy.reset(dones)
        env = self._env
        if dones is None:
            self._recorder.starts += _starts(env)
            self._running = np.ones(env.num_envs, dtype=bool)
            self._end = Episodes(*np.zeros((2, env.num_envs), dtype=int))
            self._recorder.ends.append(self._end)
            return
        self._end.steps[self._running] += 1
        ended = self._running & (dones > 0).numpy(force=True)
        self._end.outcome[ended] = env.outcome.numpy(force=True)[ended]
        self._running &= ~ended


def _starts(env: TaskEnv) -> list[Start]:
    scenes = env.sim.layout.scenes()
    if isinstance(env, NavEnv):
        steps, ways = env.most_steps.tolist(), env.way_left.tolist()
        return [Start(*start) for start in zip(scenes, steps, ways, strict=True)]
    objects = [env.sim.object.scene_object(world) for world in range(env.num_envs)]
    steps = env.max_episode_length
    return [Start(scene, steps, thing=thing) for scene, thing in zip(scenes, objects, strict=True)]


def evaluate_again(
    evaluate: Callable[..., dict[str, Any]],
    cfg: NavConfig | PickConfig,
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
        path: The same policy as an exported file.
        backend: One of `tables.backend.BACKENDS`.
        renderer: What makes depth images, one of `renderers.RENDERERS`.
        processes: How many run episodes at the same time.
        report: Receives lines of progress.

    Returns:
        The result of `evaluate`, but that `rows` and `overall` are of the other simulator. Each has its row
        of the batched run as `batched` (`overall` its success rate alone), and `difference`: success there
        minus batched, see `metrics.paired_difference`. Further `backend`, `renderer`, `timestep_s` and
        `backend_seconds`.

    Raises:
        ConfigError: The file does not fit the task.
    """
    _check(Network(path).contract, cfg)
    recorder = Recorder()
    result = evaluate(watch=recorder)
    start_s = time.monotonic()
    run = functools.partial(run_episode, path=path, cfg=cfg, renderer=renderer)
    rows = list(_with_progress(_map(run, recorder.starts, processes), len(recorder.starts), report))
    return result | {
        **_pair(rows, recorder.ends, cfg, result["rows"]),
        "backend": backend,
        "renderer": renderer,
        "timestep_s": TIMESTEP_S,
        "backend_seconds": round(time.monotonic() - start_s, 2),
    }


def _pair(
    rows: Sequence[Mapping[str, Any]],
    ends: Sequence[Episodes],
    cfg: NavConfig | PickConfig,
    batched: Sequence[Mapping[str, Any]],
) -> dict[str, Any]:
    """Sum episodes up beside the batched ones: `rows`, one for each of `batched`, and `overall`."""
    drives = isinstance(cfg, NavConfig)
    kind, summarize = (DriveEpisodes, summarize_drives) if drives else (PickEpisodes, summarize_picks)
    ours: Any = kind(**{name: np.array([row[name] for row in rows]) for name in rows[0]})
    theirs, period = Episodes.concatenate(ends), cfg.sim.control_period
    # Benchmarks give the worlds of a seed their conditions in turn.
    condition = np.concatenate([np.arange(len(end.outcome)) % len(batched) for end in ends])
    told = []
    for index, there in enumerate(batched):
        chosen = condition == index
        row = summarize(ours.select(chosen), period)
        difference = paired_difference([theirs.select(chosen)], [ours.select(chosen)])
        told.append({**there, **row, "batched": {key: there[key] for key in row}, "difference": difference})
    overall = summarize(ours, period) | {
        "batched": {"success_rate": float((theirs.outcome == episode.SUCCESS).mean())},
        "difference": paired_difference([theirs], [ours]),
    }
    return {"rows": told, "overall": overall}


def _check(contract: Contract, cfg: NavConfig | PickConfig) -> None:
    """Reject conditions that the other simulator, or the file, does not have."""
    if cfg.depth is not None and cfg.depth.noise != DepthNoiseConfig():
        raise ConfigError("depth: images of the other simulator are exact, as with depth=ideal")
    if isinstance(cfg, PickConfig) and cfg.detector != "none":
        raise ConfigError("task.detector: the other simulator tells where the object is, say none")
    pairs = {
        "task.camera_pose": (cfg.camera_pose, contract.camera.pose),
        "task.camera_mount": (cfg.camera_mount, contract.camera.mount),
        "robot.profile": (cfg.robot_profile, contract.speed_profile.name),
    }
    if isinstance(cfg, NavConfig):
        tolerance_m = None if contract.goal is None else contract.goal.tolerance_m
        pairs["task.goal_tolerance_m"] = cfg.goal_tolerance_m, tolerance_m
    for key, (asked, exported) in pairs.items():
        if asked != exported:
            raise ConfigError(f"{key}: is {asked}, and {exported} in the exported policy")


@functools.cache
def _network(path: Path) -> Network:
    return Network(path)


def run_episode(
    start: Start, *, path: Path, cfg: NavConfig | PickConfig, renderer: str = RAYS
) -> Mapping[str, Any]:
    """Run one episode in C MuJoCo, in simulated time; return what the task's `Episodes` hold of it."""
    network = _network(path)
    # The table is the first box of a scene with an object.
    thing = None if start.thing is None else (start.thing, start.scene.pool.first_box)
    one = MujocoRobot(start.scene, network.contract, renderer=renderer, thing=thing)
    umpire = one.umpire = _umpire(one, start, cfg)
    connection = one.connect()
    loop = ControlLoop(one, connection, Agent(network))
    object_b = None if connection.object_b is None else np.array(connection.object_b)
    # The goal may be reached with the last step; whether it was is seen at the next tick.
    ended = loop.run((start.most_steps + 0.5) * network.contract.period_s, start.scene.goal, object_b)
    if ended.reason.startswith("SIG"):
        raise KeyboardInterrupt
    outcomes = {ARRIVED: episode.SUCCESS, TIME_OVER: episode.TIMEOUT, _RUNSTOP: umpire.outcome}
    outcomes |= dict.fromkeys(_NOT_FINITE, episode.NON_FINITE)
    return {
        "outcome": outcomes[ended.reason],
        "steps": min(ended.steps, start.most_steps),
        **umpire.figures(one.data),
    }


def _umpire(one: MujocoRobot, start: Start, cfg: NavConfig | PickConfig) -> Umpire:
    if isinstance(cfg, NavConfig):
        return DriveUmpire(one.model, one.data, start.scene.goal, start.way)
    assert one.handled is not None and start.thing is not None
    return PickUmpire(one.model, one.handled, float(start.thing.half_extents[2]), cfg)


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
