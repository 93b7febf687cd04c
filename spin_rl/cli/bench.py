"""spin-bench: measure the throughput of kernels, environment and training beside their peers."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import torch
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from spin_rl.cli import common
from spin_rl.config import ConfigError
from spin_rl.files import write_json
from spin_rl.machine import num_cores
from spin_rl.speed import rows as throughput
from spin_rl.speed.timing import Stopwatch
from spin_rl.tasks.common.compose import plain, with_depth
from spin_rl.tasks.nav.spec import NAV

SUBJECTS = ("visibility", "depth", "env", "update", "train")
# Keys of conf/bench.yaml that spin-train does not have, or that the benchmark sets itself.
_OWN_KEYS = ("what", "device", "seconds", "world_counts", "processes", "out")
_BUSY_LOAD = 0.5


def main() -> None:
    """Entry point of the `spin-bench` command."""
    sys.argv[1:] = common.with_preset(sys.argv[1:], torch.cuda.is_available())
    common.run("bench", bench)


def bench(cfg: DictConfig) -> None:
    """Measure what `cfg` names, print the table and write the JSON."""
    values = with_depth(plain(cfg))
    out = _check(values)
    device = common.resolve_device(values["device"])
    if device == "cpu":
        torch.set_num_threads(1)  # as in training
    elif values["processes"] > torch.cuda.device_count():
        raise ConfigError(
            f"processes: {torch.cuda.device_count()} GPUs found, one for each process is needed"
        )
    _warn_if_busy()
    subjects = SUBJECTS if values["what"] == "all" else (values["what"],)
    rows = _measure(values, device, subjects)

    overrides = list(HydraConfig.get().overrides.task)
    result = throughput.result(
        device, rows, overrides=overrides, num_envs=values["num_envs"], sim=values["sim"], load=_load()
    )
    print(f"{result['hardware']}; {values['num_envs']} worlds")
    print(throughput.table(rows))
    headline = ", ".join(f"{row.name} {row.value:,.4g} {row.unit}" for row in rows[:1])
    if out is None:
        print(f"Wrote nothing, out=<file.json> keeps the figures: {headline}")
        return
    write_json(out, result)
    print(f"Wrote {out}: {len(rows)} rows, {headline}")


def _measure(values: dict[str, Any], device: str, subjects: tuple[str, ...]) -> list[throughput.Row]:
    from spin_rl.speed import (
        depth as depth_speed,
    )
    from spin_rl.speed import (
        env as env_speed,
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

    task, seed, seconds = NAV.configure(values), values["seed"], values["seconds"]
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
        return env_speed.RandomDriver(make_env(values["num_envs"], images), seed)

    def visibility() -> list[throughput.Row]:
        with common.announced(f"Timing scandots on {device}"):
            return visibility_speed.measure_visibility(task, values["num_envs"], device, seconds, seed, watch)

    def depth() -> list[throughput.Row]:
        counts = values["world_counts"] or depth_speed.WORLD_COUNTS
        return depth_speed.measure_depth(make_env, counts, device, seconds, seed, cpu_watch)

    def env() -> list[throughput.Row]:
        rows = env_speed.measure_env(driver(has_images), seconds, watch)
        rows.append(env_speed.measure_images(driver(True), driver(False), seconds, watch))
        counts = values["world_counts"] or []
        return rows + env_speed.sweep(make_env, counts, device, seconds / 4, seed, watch)

    def update() -> list[throughput.Row]:
        with common.announced(f"Timing the parts and other forms of the update on {device}"):
            return update_speed.measure_update(driver(has_images), values["runner"], seconds, cpu_watch)

    def train() -> list[throughput.Row]:
        rows, single = train_speed.measure_train(driver(has_images), values["runner"], seconds, watch)
        if values["processes"] > 1:
            overrides = [o for o in HydraConfig.get().overrides.task if o.partition("=")[0] not in _OWN_KEYS]
            kind = "cpu" if device == "cpu" else "cuda"
            steps = values["num_envs"] * values["runner"]["num_steps_per_env"]
            iterations = max(train_speed.MIN_BLOCKS, round(seconds / (single.median * steps)))
            print(f"Training in {values['processes']} processes, {iterations} iterations", flush=True)
            row = train_speed.measure_processes(values["processes"], overrides, kind, iterations, single)
            rows.append(row)
        return rows

    measures: dict[str, Callable[[], list[throughput.Row]]] = {
        "visibility": visibility,
        "depth": depth,
        "env": env,
        "update": update,
        "train": train,
    }
    return [row for subject in subjects for row in measures[subject]()]


def _check(values: dict[str, Any]) -> Path | None:
    """Reject what needs no simulator to reject; return the file to write."""
    if values["what"] not in (*SUBJECTS, "all"):
        raise ConfigError(f"what: unknown {values['what']!r}; choose from {', '.join(SUBJECTS)}, all")
    if "teacher" in values["runner"]["algorithm"]:
        name = values["algo"]["name"]
        raise ConfigError(
            f"algo: {name} learns from a teacher, which is not measured; use cvo or direct_depth"
        )
    for key in ("num_envs", "processes"):
        _require_count(key, values[key])
    if type(values["seed"]) is not int:
        raise ConfigError(f"seed: expected a whole number, got {values['seed']!r}")
    counts = values["world_counts"]
    if counts is not None and not isinstance(counts, list):
        raise ConfigError(f"world_counts: expected a list such as [256,1024], got {counts!r}")
    for count in counts or []:
        _require_count("world_counts", count)
    seconds = values["seconds"]
    if type(seconds) not in (int, float) or not 0.0 < seconds < float("inf"):
        raise ConfigError(f"seconds: expected a positive number, got {seconds!r}")
    return common.output_file(values["out"], "bench.json")


def _require_count(key: str, value: Any) -> None:
    if type(value) is not int or value < 1:
        raise ConfigError(f"{key}: expected whole numbers of at least 1, got {value!r}")


def _load() -> float | None:
    """Processes that wanted a core in the last minute, per core; None where the system does not tell."""
    return os.getloadavg()[0] / num_cores() if hasattr(os, "getloadavg") else None


def _warn_if_busy() -> None:
    load = _load()
    if load is not None and load > _BUSY_LOAD:
        print(f"warning: other work keeps this machine busy, load {load:.1f} per core", file=sys.stderr)


if __name__ == "__main__":
    main()
