"""spin-bench: measure the throughput of kernels, environment and training beside their peers."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any

import torch

from spin_rl.cli import common
from spin_rl.config import POSITIVE, Choice, ConfigError, Range, from_keys
from spin_rl.files import write_json
from spin_rl.machine import num_cores
from spin_rl.speed import rows as throughput
from spin_rl.speed.timing import Stopwatch
from spin_rl.tasks.common.compose import with_depth
from spin_rl.tasks.nav.spec import NAV

SUBJECTS = ("visibility", "depth", "env", "update", "train", "places")
# Keys of conf/bench.yaml that spin-train does not have, or that the benchmark sets itself.
_OWN_KEYS = ("what", "device", "seconds", "world_counts", "processes", "out")
_BUSY_LOAD = 0.5

Count = Annotated[int, Range(1)]


@dataclass(frozen=True)
class Options:
    """What to measure, checked.

    Attributes:
        what: One of `SUBJECTS`, or all.
        num_envs: Worlds.
        seed: Of scenes and actions.
        seconds: To measure each subject for [s].
        world_counts: Further numbers of worlds, or None.
        processes: Of the training.
        out: JSON to write, or None.
        device: "cpu" or "cuda:N".
        overrides: Those of the command line.
    """

    what: Annotated[str, Choice((*SUBJECTS, "all"))]
    num_envs: Count
    seed: int
    seconds: Annotated[float, POSITIVE]
    world_counts: tuple[Count, ...] | None
    processes: Count
    out: Path | None
    device: str
    overrides: tuple[str, ...]


def main() -> None:
    """Entry point of the `spin-bench` command."""
    common.run("bench", bench, lambda given: (common.with_preset(given, torch.cuda.is_available()), None))


def bench(call: common.Call) -> None:
    """Measure what was asked for, print the table and write the JSON."""
    values = with_depth(call.values)
    options = read_options(values, call.overrides)
    if options.device == "cpu":
        torch.set_num_threads(1)  # as in training
    _warn_if_busy()
    rows = _measure(values, options)

    result = throughput.result(
        options.device,
        rows,
        overrides=options.overrides,
        num_envs=options.num_envs,
        sim=values["sim"],
        load=_load(),
    )
    print(f"{result['hardware']}; {options.num_envs} worlds")
    print(throughput.table(rows))
    headline = ", ".join(f"{row.name} {row.value:,.4g} {row.unit}" for row in rows[:1])
    if options.out is None:
        print(f"Wrote nothing, out=<file.json> keeps the figures: {headline}")
        return
    write_json(options.out, result)
    print(f"Wrote {options.out}: {len(rows)} rows, {headline}")


def _measure(values: dict[str, Any], options: Options) -> list[throughput.Row]:
    from spin_rl.speed import (
        depth as depth_speed,
    )
    from spin_rl.speed import (
        env as env_speed,
    )
    from spin_rl.speed import (
        places as places_speed,
    )
    from spin_rl.speed import (
        scandots as visibility_speed,
    )
    from spin_rl.speed import (
        train as train_speed,
    )
    from spin_rl.speed import (
        update as update_speed,
    )
    from spin_rl.tasks.nav.env import NavEnv

    task, runner = NAV.configure(values), values["runner"]
    device, seed, seconds = options.device, options.seed, options.seconds
    synchronize = partial(torch.cuda.synchronize, device) if device != "cpu" else lambda: None
    watch = Stopwatch(synchronize)
    # For what runs in one thread: CPU time, which other load bends least.
    cpu_watch = Stopwatch(clock=time.process_time) if device == "cpu" else watch

    has_images = task.depth is not None
    with_images = NAV.configure(values | {"task": values["task"] | {"depth": {"enabled": True}}})
    tasks = {True: with_images, False: replace(task, depth=None)}

    def make_env(num_envs: int, images: bool = has_images) -> NavEnv:
        with common.announced(f"Starting {num_envs} worlds on {device}{', with images' if images else ''}"):
            return NavEnv(tasks[images], num_envs, device, seed=seed)

    @cache
    def driver(images: bool) -> env_speed.RandomDriver:
        return env_speed.RandomDriver(make_env(options.num_envs, images), seed)

    def visibility() -> list[throughput.Row]:
        with common.announced(f"Timing scandots on {device}"):
            return visibility_speed.measure_visibility(task, options.num_envs, device, seconds, seed, watch)

    def depth() -> list[throughput.Row]:
        counts = options.world_counts or depth_speed.WORLD_COUNTS
        return depth_speed.measure_depth(make_env, counts, device, seconds, seed, cpu_watch)

    def env() -> list[throughput.Row]:
        rows = env_speed.measure_env(driver(has_images), seconds, watch)
        rows.append(env_speed.measure_images(driver(True), driver(False), seconds, watch))
        counts = options.world_counts or []
        return rows + env_speed.sweep(make_env, counts, device, seconds / 4, seed, watch)

    def update() -> list[throughput.Row]:
        with common.announced(f"Timing the parts and other forms of the update on {device}"):
            return update_speed.measure_update(driver(has_images), runner, seconds, cpu_watch)

    def train() -> list[throughput.Row]:
        rows, single = train_speed.measure_train(driver(has_images), runner, seconds, watch)
        if options.processes > 1:
            overrides = [o for o in options.overrides if o.partition("=")[0] not in _OWN_KEYS]
            kind = "cpu" if device == "cpu" else "cuda"
            steps = options.num_envs * runner["num_steps_per_env"]
            iterations = max(train_speed.MIN_BLOCKS, round(seconds / (single.median * steps)))
            print(f"Training in {values['processes']} processes, {iterations} iterations", flush=True)
            row = train_speed.measure_processes(options.processes, overrides, kind, iterations, single)
            rows.append(row)
        return rows

    def places() -> list[throughput.Row]:
        with common.announced(f"Starting corridors, the mixture and example scenes on {device}"):
            envs = places_speed.make_places(options.overrides, options.num_envs, device, seed)
        return places_speed.measure_places(envs, runner, seconds, seed, cpu_watch)

    measures: dict[str, Callable[[], list[throughput.Row]]] = {
        "visibility": visibility,
        "depth": depth,
        "env": env,
        "update": update,
        "train": train,
        "places": places,
    }
    subjects = SUBJECTS if options.what == "all" else (options.what,)
    return [row for subject in subjects for row in measures[subject]()]


def read_options(values: Mapping[str, Any], overrides: Sequence[str]) -> Options:
    """Reject what needs no simulator to reject, and make the folder of `out`.

    Raises:
        ConfigError: One line that names the key.
    """
    found = {"device": common.resolve_device(values["device"]), "overrides": tuple(overrides)}
    options = from_keys(Options, {**values, **found})
    if "teacher" in values["runner"]["algorithm"]:
        name = values["algo"]["name"]
        raise ConfigError(
            f"algo: {name} learns from a teacher, which is not measured; use cvo or direct_depth"
        )
    if options.device != "cpu" and options.processes > torch.cuda.device_count():
        raise ConfigError(
            f"processes: {torch.cuda.device_count()} GPUs found, one for each process is needed"
        )
    common.make_folder_of(options.out, "bench.json")
    return options


def _load() -> float | None:
    """Processes that wanted a core in the last minute, per core; None where the system does not tell."""
    return os.getloadavg()[0] / num_cores() if hasattr(os, "getloadavg") else None


def _warn_if_busy() -> None:
    load = _load()
    if load is not None and load > _BUSY_LOAD:
        print(f"warning: other work keeps this machine busy, load {load:.1f} per core", file=sys.stderr)


if __name__ == "__main__":
    main()
