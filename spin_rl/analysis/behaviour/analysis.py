"""What a policy does in a benchmark of the navigation task: tendencies of camera and arm, and behaviours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from spin_rl.analysis.behaviour.events import BEHAVIOURS, FAILED, NOT_NEEDED, SHOWN, Event, events_of
from spin_rl.analysis.behaviour.series import series_of
from spin_rl.analysis.behaviour.tendencies import as_dict, tendencies_of
from spin_rl.analysis.behaviour.trace import DriveTrace
from spin_rl.analysis.behaviour.watch import BehaviourWatch
from spin_rl.analysis.episodes import replay, run_watched
from spin_rl.benchmark.metrics import wilson_interval
from spin_rl.benchmark.registry import Benchmark
from spin_rl.policy import PolicyFactory
from spin_rl.scenes.layout import Scene
from spin_rl.tasks.nav.config import NavConfig


def analyse_behaviour(
    benchmark: Benchmark,
    make_policy: PolicyFactory,
    cfg: NavConfig,
    episodes: int,
    seeds: Sequence[int],
    device: str,
    *,
    overrides: Sequence[str] = (),
    scene: Scene | None = None,
    scene_file: Path | None = None,
    **options: Any,
) -> dict[str, Any]:
    """Run a benchmark and follow every episode.

    Args:
        benchmark: One of the navigation task.
        make_policy: Makes the policy once observations exist.
        cfg: Task configuration.
        episodes: Episodes per condition and seed; all of a seed run at once.
        seeds: Seeds, all different.
        device: "cpu" or "cuda:N".
        overrides: Settings of the task that a replay needs as well, for the result.
        scene: The one scene to run in, None for the benchmark's.
        scene_file: Its file.
        options: See `run_watched`.

    Returns:
        The benchmark's result; with `analysis` ("behaviour"), `tendencies` by name (see `Tendency`),
        `behaviours` by name (counts, see `count`) and `events` (see `Event`, with the episode's `outcome`,
        `condition`, and `play`, the overrides of spin-play that show it; the first that was shown and the
        first that failed of each behaviour, in episodes of their own where there are, also with `series`).

    Raises:
        ConfigError: Too few worlds, or whatever the benchmark refuses.
    """
    result, watches, names = run_watched(
        BehaviourWatch,
        benchmark,
        make_policy,
        cfg,
        episodes,
        seeds,
        device,
        scene=scene,
        scene_file=scene_file,
        **options,
    )
    traces = [
        replace(trace, condition=names[trace.world % len(names)])
        for watched in watches
        for trace in watched.traces
    ]
    found = [(trace, event) for trace in traces for event in events_of(trace)]
    examples = examples_of(found)
    return result | {
        "analysis": "behaviour",
        "tendencies": {name: as_dict(tendency) for name, tendency in tendencies_of(traces).items()},
        "behaviours": {
            name: count([event for _, event in found if event.behaviour == name]) for name in BEHAVIOURS
        },
        "events": [
            _told(trace, event, replay(trace, result, scene_file, overrides))
            | ({"series": series_of(trace, event)} if any(event is chosen for chosen in examples) else {})
            for trace, event in found
        ],
    }


def examples_of(found: Sequence[tuple[DriveTrace, Event]]) -> list[Event]:
    """Choose an event of each behaviour that was shown and of each that failed.

    Returns:
        The first that is in an episode of its own, or else the first.
    """
    chosen: dict[tuple[str, str], Event] = {}
    taken: set[int] = set()
    for name in BEHAVIOURS:
        for result in (SHOWN, FAILED):
            fitting = [
                (trace, event) for trace, event in found if (event.behaviour, event.result) == (name, result)
            ]
            if fitting:
                own = [(trace, event) for trace, event in fitting if id(trace) not in taken]
                trace, chosen[name, result] = (own or fitting)[0]
                taken.add(id(trace))
    return list(chosen.values())


def count(events: Sequence[Event]) -> dict[str, Any]:
    """Count what became of the situations of a behaviour.

    Returns:
        `situations`, how many of them are `shown`, `not_needed` and `failed`, and the share that is shown,
        with its 95 % Wilson interval, None without situations.
    """
    counts = {
        result: sum(event.result == result for event in events) for result in (SHOWN, NOT_NEEDED, FAILED)
    }
    total = len(events)
    return {
        "situations": total,
        **{result.replace(" ", "_"): number for result, number in counts.items()},
        "shown_share": counts[SHOWN] / total if total else None,
        "ci95": list(wilson_interval(counts[SHOWN], total)) if total else None,
    }


def _told(trace: DriveTrace, event: Event, play: str) -> dict[str, Any]:
    own = {"seed": trace.seed, "world": trace.world, "condition": trace.condition, "outcome": trace.outcome}
    return asdict(event) | own | {"time_s": round(event.time_s, 3), "play": play}
