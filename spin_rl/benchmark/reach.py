"""The reach benchmark: six corridors (2 scenarios x 3 difficulties), or one scene from a file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spin_rl.benchmark.drives import describe_drives, run_drives
from spin_rl.benchmark.metrics import DriveEpisodes, summarize_drives
from spin_rl.benchmark.rounds import Announce, WatchPolicy, check_counts, run_seeds
from spin_rl.policy import Policy, PolicyFactory
from spin_rl.scenes.kinds import DIFFICULTIES, SCENARIOS
from spin_rl.scenes.layout import Layout, PoolSpec, Scene
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.env import NavEnv


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
    announce: Announce | None = None,
    report: Callable[[str], None] = print,
    watch: WatchPolicy | None = None,
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
        watch: Looks on, see `rounds.run_seeds`.

    Returns:
        `policy`, `benchmark`, `rows` (see `metrics.summarize_drives`, with `scenario` and `difficulty`), and
        the settings under which the rows were measured; `alike` where all episodes were the same one.

    Raises:
        ConfigError: No episodes, no seeds, the same seed twice, or no worlds.
    """
    check_counts(episodes, seeds, num_envs)
    cells = REACH_CELLS if scene is None else (Cell(scene_name, "scene"),)
    fixed = None if scene is None else in_usual_pool(scene)
    groups, facts = run_seeds(
        lambda nworld: NavEnv(cfg, nworld, device, scene=fixed),
        make_policy,
        lambda env, policy, report: run_cells(env, policy, cells, episodes, report=report),
        len(cells) * episodes,
        seeds,
        device,
        num_envs=num_envs,
        announce=announce,
        report=report,
        watch=watch,
    )
    if scene is not None and are_alike(groups[0]):
        facts["alike"] = True
        report(
            f"scene: all {len(groups[0].outcome)} episodes are the same one, so the interval means nothing: "
            "policy, start and dynamics are fixed; starts=50 draws different trips"
        )
    rows = [
        {"scenario": cell.scenario, "difficulty": cell.difficulty}
        | summarize_drives(group, cfg.sim.control_period)
        for cell, group in zip(cells, groups, strict=True)
    ]
    return {
        "policy": policy_name,
        "benchmark": "reach",
        "rows": rows,
        "episodes_per_seed": episodes,
        **describe_drives(cfg),
        **facts,
    }


def are_alike(episodes: DriveEpisodes) -> bool:
    """Whether several episodes are one and the same, to the last bit of where they ended."""
    ends = (episodes.outcome, episodes.steps, episodes.distance, episodes.driven)
    return len(episodes.outcome) > 1 and all(np.ptp(values) == 0 for values in ends)


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


def run_cells(
    env: NavEnv,
    policy: Policy,
    cells: Sequence[Cell],
    episodes: int,
    *,
    report: Callable[[str], None] = print,
) -> list[DriveEpisodes]:
    """Run exactly `episodes` episodes of every cell, see `rounds.run_rounds`.

    Args:
        env: Environment with any number of worlds.
        policy: Policy for it.
        cells: Conditions; one with a name instead of a number leaves the environment's own scene.
        episodes: Episodes per cell.
        report: Receives lines of progress.

    Returns:
        Episodes of every cell, in the order of `cells`.
    """

    def prepare(chosen: np.ndarray) -> None:
        if not isinstance(cells[0].scenario, str):
            env.set_cells(
                [int(cells[c].scenario) for c in chosen],
                [DIFFICULTIES.index(cells[c].difficulty) for c in chosen],
            )

    return run_drives(env, policy, len(cells), episodes, prepare, report=report)
