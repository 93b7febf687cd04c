"""The reach benchmark: six corridors (2 scenarios x 3 difficulties), or one scene from a file."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch

from spin_rl import robot
from spin_rl.benchmark.metrics import Episodes, summarize
from spin_rl.benchmark.throughput import commit
from spin_rl.config import ConfigError
from spin_rl.policy import Policy, PolicyFactory
from spin_rl.scenes.kinds import DIFFICULTIES, SCENARIOS
from spin_rl.scenes.layout import Layout, PoolSpec, Scene
from spin_rl.tasks.config import NavConfig
from spin_rl.tasks.nav import NavEnv

# Worlds in one batch: a CPU core has no use for more, and a GPU is full.
_MAX_WORLDS = {"cpu": 600, "cuda": 16384}
# Reading the flags waits for the device.
_STEPS_BETWEEN_CHECKS = 5
_SECONDS_BETWEEN_REPORTS = 5.0
# Far from any seed that a training takes, so that its first corridors are not those of the benchmark.
SEED_OFFSET = 1_000_000


@dataclass(frozen=True)
class Cell:
    """One condition of the benchmark; `scenario` is a scene file's name where there is one."""

    scenario: int | str
    difficulty: str


REACH_CELLS = tuple(Cell(scenario, difficulty) for scenario in SCENARIOS for difficulty in DIFFICULTIES)


def evaluate_reach(
    make_policy: PolicyFactory,
    cfg: NavConfig,
    episodes: int,
    seeds: Sequence[int],
    device: str,
    *,
    policy_name: str = "policy",
    num_envs: int | None = None,
    scene: Scene | None = None,
    scene_name: str = "scene",
    announce: Callable[[str], contextlib.AbstractContextManager[Any]] | None = None,
    report: Callable[[str], None] = print,
) -> dict[str, Any]:
    """Run the benchmark.

    Every seed is a batch of its own: its corridors depend on the seed and the number of worlds only.

    Args:
        make_policy: Makes the policy once observations exist.
        cfg: Task configuration; its scenario and difficulty are set per world.
        episodes: Episodes per cell and seed.
        seeds: Seeds of corridors, start poses and goals, all different.
        device: "cpu" or "cuda:N".
        policy_name: For the result.
        num_envs: Most worlds at once; None takes all episodes at once as far as that is sensible.
        scene: Evaluates in this one scene, the same in every world, instead of the six cells.
        scene_name: Its name in the result.
        announce: Context manager factory around work that may compile kernels.
        report: Receives lines of progress.

    Returns:
        `policy`, `benchmark`, `rows` (see `metrics.summarize`, with `scenario` and `difficulty`), and the
        settings under which the rows were measured.

    Raises:
        ConfigError: No episodes, no seeds, the same seed twice, or no worlds.
    """
    _check_counts(episodes, seeds, num_envs)
    cells = REACH_CELLS if scene is None else (Cell(scene_name, "scene"),)
    nworld = batch_size(len(cells) * episodes, num_envs, device)
    start = time.monotonic()
    per_cell: list[list[Episodes]] = [[] for _ in cells]
    with announce(f"Starting {nworld} worlds on {device}") if announce else contextlib.nullcontext():
        env = NavEnv(cfg, nworld, device, scene=in_usual_pool(scene) if scene else None)
    policy = make_policy(env.get_observations(), device)
    env.health.clear()
    for seed in seeds:
        env.reseed(SEED_OFFSET + seed)
        groups = run_cells(
            env, policy, cells, episodes, report=lambda line, seed=seed: report(f"  seed {seed}: {line}")
        )
        for collected, group in zip(per_cell, groups, strict=True):
            collected.append(group)
    rows = [
        {"scenario": cell.scenario, "difficulty": cell.difficulty}
        | summarize(Episodes.concatenate(collected), cfg.sim.control_period)
        for cell, collected in zip(cells, per_cell, strict=True)
    ]
    overflows = {name: count for name, count in env.health.read().items() if count}
    return {
        "policy": policy_name,
        "benchmark": "reach",
        "rows": rows,
        "seeds": list(seeds),
        "episodes_per_seed": episodes,
        "num_envs": nworld,
        "device": device,
        "robot": cfg.robot_profile,
        "camera_mount": cfg.camera_mount,
        "episode_s": cfg.episode_s,
        "goal_tolerance_m": cfg.goal_tolerance_m,
        "sim": asdict(cfg.sim),
        "scandots": asdict(cfg.scandots),
        "depth": None if cfg.depth is None else asdict(cfg.depth),
        "noise": asdict(cfg.noise),
        "overflows": overflows,
        "commit": commit(),
        "seconds": round(time.monotonic() - start, 2),
    }


def _check_counts(episodes: int, seeds: Sequence[int], num_envs: int | None) -> None:
    if episodes < 1:
        raise ConfigError(f"episodes: at least 1 per cell is needed, got {episodes}")
    if not seeds:
        raise ConfigError("seeds: at least one is needed, such as seeds=[0]")
    if len(set(seeds)) < len(seeds):
        raise ConfigError(f"seeds: every seed may appear once, got {list(seeds)}")
    if num_envs is not None and num_envs < 1:
        raise ConfigError(f"num_envs: at least 1 is needed, got {num_envs}")


def in_usual_pool(scene: Scene) -> Scene:
    """The same scene in the pool of the corridors, larger where the scene needs more slots.

    With the usual slots, kernels need no new compilation and policies find the usual number of scandots.
    """
    counts = ("num_walls", "num_boxes", "num_cylinders")
    usual = PoolSpec()
    pool = PoolSpec(**{name: max(getattr(usual, name), getattr(scene.pool, name)) for name in counts})
    layout = Layout(1, pool, "cpu")
    layout.load(scene)
    return layout.scene(0)


def batch_size(episodes: int, num_envs: int | None, device: str) -> int:
    """Number of worlds that spreads episodes evenly over the fewest rounds.

    Args:
        episodes: Episodes of all cells together.
        num_envs: Most worlds at once, or None for the device's limit.
        device: "cpu" or "cuda:N".
    """
    limit = num_envs or _MAX_WORLDS[torch.device(device).type]
    rounds = math.ceil(episodes / limit)
    return math.ceil(episodes / rounds)


def run_cells(
    env: NavEnv,
    policy: Policy,
    cells: Sequence[Cell],
    episodes: int,
    *,
    report: Callable[[str], None] = print,
) -> list[Episodes]:
    """Run exactly `episodes` episodes of every cell.

    In each round every world is given a cell, starts anew, and contributes the first episode after that
    start, however long it takes: taking whatever ends first would prefer short episodes.

    Args:
        env: Environment with any number of worlds.
        policy: Policy for it.
        cells: Conditions; one with a name instead of a number leaves the environment's own scene.
        episodes: Episodes per cell.
        report: Receives lines of progress.

    Returns:
        Episodes of every cell, in the order of `cells`.
    """
    # Cells alternate, so that every round has about the same mix of short and long episodes.
    queue = np.tile(np.arange(len(cells)), episodes)
    finished: list[Episodes] = []
    progress = _Progress(len(queue), report)
    for first in range(0, len(queue), env.num_envs):
        assigned = queue[first : first + env.num_envs]
        # The last round may have fewer episodes than worlds; what the others do is not looked at.
        filled = np.resize(assigned, env.num_envs)
        if not isinstance(cells[0].scenario, str):
            env.set_cells(
                [int(cells[c].scenario) for c in filled],
                [DIFFICULTIES.index(cells[c].difficulty) for c in filled],
            )
        # A world's corridor must not depend on how often it started anew before, which is up to the policy.
        env.set_episode(len(finished))
        finished.append(_run_round(env, policy, len(assigned), progress))
    everything = Episodes.concatenate(finished)
    return [everything.select(queue == c) for c in range(len(cells))]


class _Progress:
    """Prints how many episodes are done, now and then."""

    def __init__(self, total: int, report: Callable[[str], None]) -> None:
        self._total = total
        self._report = report
        self._before = 0
        self._start = self._last = time.monotonic()

    def show(self, in_round: int) -> None:
        """Tell about the episodes of the running round."""
        now = time.monotonic()
        if now - self._last >= _SECONDS_BETWEEN_REPORTS:
            self._last = now
            self._line(self._before + in_round)

    def add_round(self, count: int) -> None:
        """Count a finished round."""
        self._before += count
        if self._before == self._total:
            self._line(self._before)

    def _line(self, done: int) -> None:
        self._report(f"{done} of {self._total} episodes after {time.monotonic() - self._start:.0f} s")


@torch.no_grad()
def _run_round(env: NavEnv, policy: Policy, count: int, progress: _Progress) -> Episodes:
    """Run the first episode of worlds 0 to `count` - 1 to its end."""
    obs = env.reset()
    policy.reset()
    n = env.num_envs
    running = torch.arange(n, device=env.device) < count
    outcome = torch.zeros(n, dtype=torch.int32, device=env.device)
    steps = torch.zeros(n, dtype=torch.int32, device=env.device)
    distance = torch.zeros(n, device=env.device)
    parts = torch.zeros(n, len(robot.PARTS), dtype=torch.bool, device=env.device)
    for step in range(1, env.max_episode_length + 1):
        obs, _, done, _ = env.step(policy(obs))
        policy.reset(done)
        assert env.last_transition is not None
        ended = running & (done > 0)
        outcome = torch.where(ended, env.outcome, outcome)
        steps = torch.where(ended, step, steps)
        distance = torch.where(ended, env.last_transition.goal_distance, distance)
        parts = torch.where(ended[:, None], env.sim.views.part_contacts, parts)
        running = running & ~ended
        if step % _STEPS_BETWEEN_CHECKS == 0:
            left = int(running.sum())
            if left == 0:
                break
            progress.show(count - left)
    if bool(running.any()):
        raise RuntimeError("an episode went on beyond the time limit")
    progress.add_round(count)
    return Episodes(*(values[:count].cpu().numpy() for values in (outcome, steps, distance, parts)))
