"""The fetch and place benchmarks: whole fetches in six corridors with a table at the end (SPIN, Table 1)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from spin_rl.benchmark.metrics import Episodes, ReachEpisodes, summarize, wilson_interval
from spin_rl.benchmark.reach import REACH_CELLS
from spin_rl.benchmark.rounds import (
    Announce,
    Report,
    WatchPolicy,
    check_counts,
    describe_task,
    run_rounds,
    run_seeds,
)
from spin_rl.policy import Policy, PolicyFactory
from spin_rl.scenes.kinds import DIFFICULTIES
from spin_rl.scenes.objects.shapes import OBJECTS
from spin_rl.tasks.common.objects.config import ANY_OBJECT, object_names
from spin_rl.tasks.fetch.config import STAGES, FetchConfig
from spin_rl.tasks.fetch.env import FetchEnv
from spin_rl.tasks.fetch.results import FetchEpisodes, record_views
from spin_rl.tasks.fetch.state import FETCH_OUTCOMES

PART_STAGES = {"reach": ("reach",), "pick": ("align", "pick"), "place": ("retract", "carry", "place")}
"""Part of the paper's table -> the stages whose time it takes."""
_RULES = (
    "object",
    "detector",
    "pick_range_m",
    "tell_table",
    "retries",
    "goal_tolerance_m",
    "home_tolerance_m",
    "lift_m",
    "hold_s",
    "grasp_force_n",
    "finger_force_n",
    "hard_force_n",
    "fall_m",
    "place_m",
    "head_sweeps",
    "carry_moves",
    "carry_lift_m",
)
_DROPPED = FETCH_OUTCOMES.index("dropped")


@dataclass
class Fetches(FetchEpisodes, ReachEpisodes):
    """Finished fetches as a benchmark counts them; what is to come near a place here is the object."""


def evaluate_fetch(
    make_policy: PolicyFactory,
    cfg: FetchConfig,
    episodes: int,
    seeds: Sequence[int],
    device: str,
    *,
    benchmark: str = "fetch",
    policy_name: str = "policy",
    pick_name: str = "policy",
    num_envs: int | None = None,
    announce: Announce | None = None,
    report: Report = print,
    watch: WatchPolicy | None = None,
) -> dict[str, Any]:
    """Run the benchmark.

    Every seed is a batch of its own: its scenes depend on the seed and the number of worlds only.

    Args:
        make_policy: Makes the policy of both stages once observations exist, a `FetchPolicy`.
        cfg: Task configuration; its scenario and difficulty are set per world. It may name one object.
        episodes: Fetches per cell and seed, with the objects in turn.
        seeds: Seeds of corridors, tables, objects and start poses, all different.
        device: "cpu" or "cuda:N".
        benchmark: "fetch", or "place", whose `duration_s` is that of the part `place`.
        policy_name: The policy that drives, for the result.
        pick_name: The policy that picks, for the result.
        num_envs: Most worlds at once; None takes all episodes at once as far as that is sensible.
        announce: Context manager factory around work that may compile kernels.
        report: Receives lines of progress.
        watch: Looks on, see `rounds.run_seeds`.

    Returns:
        `policy`, `pick`, `benchmark`, `overall`, `rows` (see `summarize_fetches`, with `scenario` and
        `difficulty`), `objects` (likewise, over all cells, named by `object`), and the settings under which
        they were measured.

    Raises:
        ConfigError: No episodes, no seeds, the same seed twice, or no worlds.
    """
    check_counts(episodes, seeds, num_envs)
    groups, facts = run_seeds(
        lambda nworld: FetchEnv(cfg, nworld, device),
        make_policy,
        lambda env, policy, report: run_fetches(env, policy, episodes, report=report),
        len(REACH_CELLS) * episodes,
        seeds,
        device,
        num_envs=num_envs,
        announce=announce,
        report=report,
        watch=watch,
    )

    def told(fetches: Fetches) -> dict[str, Any]:
        row = summarize_fetches(fetches, cfg.sim.control_period)
        return row if benchmark == "fetch" else row | {"duration_s": row["place"]["duration_s"]}

    everything = Episodes.concatenate(groups)
    return {
        "policy": policy_name,
        "pick": pick_name,
        "benchmark": benchmark,
        "overall": told(everything),
        "rows": [
            {"scenario": cell.scenario, "difficulty": cell.difficulty} | told(group)
            for cell, group in zip(REACH_CELLS, groups, strict=True)
        ],
        "objects": [
            {"object": OBJECTS[kind]} | told(everything.select(everything.kind == kind))
            for kind in np.unique(everything.kind)
        ],
        "episodes_per_seed": episodes,
        **{name: getattr(cfg, name) for name in _RULES},
        "limits": asdict(cfg.limits),
        "scandots": asdict(cfg.scandots),
        "sight": asdict(cfg.sight),
        "noise": asdict(cfg.noise),
        **describe_task(cfg),
        **facts,
    }


def run_fetches(env: FetchEnv, policy: Policy, episodes: int, *, report: Report = print) -> list[Fetches]:
    """Run exactly `episodes` fetches in every cell, in turn with every object; see `rounds.run_rounds`.

    Args:
        env: Environment with any number of worlds; if its configuration names an object, with that alone.
        policy: Policy for it.
        episodes: Fetches per cell.
        report: Receives lines of progress.

    Returns:
        Fetches of every cell, in the order of `REACH_CELLS`.
    """
    kinds = OBJECTS if env.cfg.object == ANY_OBJECT else object_names(env.cfg.object)
    # Cells alternate, so that every round has about the same mix of short and long episodes; each cell begins
    # with another object, so that few fetches have all objects too.
    turn, cell = np.divmod(np.arange(len(REACH_CELLS) * episodes), len(REACH_CELLS))
    queue = cell * len(kinds) + (turn + cell) % len(kinds)

    def prepare(chosen: np.ndarray) -> None:
        cells = [REACH_CELLS[c] for c in chosen // len(kinds)]
        env.set_cells(
            [int(cell.scenario) for cell in cells], [DIFFICULTIES.index(cell.difficulty) for cell in cells]
        )
        env.set_objects([kinds[k] for k in chosen % len(kinds)])

    everything = run_rounds(
        env, policy, queue, prepare, partial(record_views, env._record), Fetches, report=report
    )
    return [everything.select(cell == c) for c in range(len(REACH_CELLS))]


def summarize_fetches(fetches: Fetches, control_period: float) -> dict[str, Any]:
    """Compute the figures of one row.

    Args:
        fetches: At least one finished fetch.
        control_period: Duration of a control step [s].

    Returns:
        As `metrics.summarize`, of whole fetches: `success_rate` is the share of those placed,
        `final_distance_m` from the robot's start to the object. Further `dropped_rate`, the share that ended
        with a lost object; `causes`, shares of the failures by stage and outcome (see `FetchEpisodes.cause`),
        which sum to 1 where anything failed; the parts `reach`, `pick` and `place`, see `_part`; sums of
        `retries`, `drops` and `scrapes` [control steps] over all fetches; and `stage_s`, the mean time in
        each stage over successful fetches [s], None without one. And `outcomes`, as of
        `metrics.summarize_drives`.
    """
    failed = np.flatnonzero(~fetches.placed).tolist()
    causes = Counter(fetches.cause(row) for row in failed)
    stage_s = fetches.stage_steps * control_period
    part_s = {
        part: stage_s[:, [STAGES.index(name) for name in names]].sum(1) for part, names in PART_STAGES.items()
    }
    everyone = np.ones(len(fetches.outcome), dtype=bool)
    return summarize(fetches, control_period) | {
        "dropped_rate": float((fetches.outcome == _DROPPED).mean()),
        "causes": {name: count / len(failed) for name, count in causes.most_common()},
        "reach": _part(everyone, fetches.reached, part_s["reach"]),
        "pick": _part(fetches.reached, fetches.picked, part_s["pick"]),
        "place": _part(fetches.picked, fetches.placed, part_s["place"]),
        **{name: int(getattr(fetches, name).sum()) for name in ("retries", "drops", "scrapes")},
        "stage_s": {name: _mean(stage_s[fetches.placed, i]) for i, name in enumerate(STAGES)},
        "outcomes": "".join(FETCH_OUTCOMES[outcome][0] for outcome in fetches.outcome),
    }


def _part(tried: np.ndarray, succeeded: np.ndarray, seconds: np.ndarray) -> dict[str, Any]:
    """Figures of a part of a fetch.

    `success_rate` and `ci95` (Wilson) are out of all fetches, `success_rate_of_tried` and `ci95_of_tried`
    out of those that came so far, None without one; `tried` and `succeeded` are counts, `duration_s` is the
    mean over those that succeeded [s].
    """
    count, tries, successes = len(tried), int(tried.sum()), int(succeeded.sum())
    return {
        "success_rate": successes / count,
        "ci95": list(wilson_interval(successes, count)),
        "tried": tries,
        "succeeded": successes,
        "success_rate_of_tried": successes / tries if tries else None,
        "ci95_of_tried": list(wilson_interval(successes, tries)) if tries else None,
        "duration_s": _mean(seconds[succeeded]),
    }


def _mean(values: np.ndarray) -> float | None:
    return float(values.mean()) if len(values) else None
