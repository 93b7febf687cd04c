"""spin-bench: measure the throughput of kernels, environment and training beside their peers."""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

from spin_rl.cli import common
from spin_rl.cli.train import Algorithm
from spin_rl.config import Choice, ConfigError, Range, check_value, from_keys, from_mapping
from spin_rl.files import write_json
from spin_rl.machine import num_cores, num_gpus
from spin_rl.ranges import NumEnvs, Seed
from spin_rl.speed import rows as throughput
from spin_rl.tasks.common.compose import with_depth
from spin_rl.tasks.nav.spec import NAV

SUBJECTS = ("visibility", "depth", "env", "update", "train", "places", "deploy")
# Keys of conf/bench.yaml that spin-train does not have, or that the benchmark sets itself.
_OWN_KEYS = ("what", "device", "seconds", "world_counts", "processes", "out")
_BUSY_LOAD = 0.5

Processes = Annotated[int, Range(1, 1024)]


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
    num_envs: NumEnvs
    seed: Seed
    seconds: Annotated[float, Range(0.0, 100_000.0, above=True)]
    world_counts: tuple[NumEnvs, ...] | None
    processes: Processes
    out: Path | None
    device: str
    overrides: tuple[str, ...]


def main() -> None:
    """Entry point of the `spin-bench` command."""
    keys = common.keys_of(Options, common.GROUPS | {"teacher"})
    common.run("bench", bench, lambda given: (common.with_preset(given), None), keys)


def bench(call: common.Call) -> None:
    """Measure what was asked for, print the table and write the JSON."""
    options = read_options(call.values, call.overrides)
    values = with_depth(call.values)
    if options.device == "cpu":
        import torch

        torch.set_num_threads(1)  # as in training
    _warn_if_busy()
    rows = _measure(values, options)

    result = throughput.result(
        options.device,
        rows,
        overrides=[given for given in options.overrides if not given.startswith("out=")],
        num_envs=options.num_envs,
        sim=values["sim"],
        load=_load(),
    )
    print(f"{result['hardware']}; {options.num_envs} worlds")
    print(throughput.table(rows))
    headline = ", ".join(f"{row.name} {row.value:,.4g} {row.unit}" for row in rows[:1])
    if options.out is None:
        print(f"{headline} (out=<file.json> keeps the figures)")
        return
    write_json(options.out, result)
    print(f"Wrote {options.out}: {len(rows)} rows, {headline}")


def _measure(values: dict[str, Any], options: Options) -> list[throughput.Row]:
    import torch

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
    from spin_rl.speed.timing import Stopwatch
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

    def deploy() -> list[throughput.Row]:
        from spin_rl.export.write import export_policy
        from spin_rl.runners.policy_file import read_policy
        from spin_rl.speed.deploy import POLICIES, measure_deploy

        with tempfile.TemporaryDirectory() as folder:
            files = [
                export_policy(read_policy(name), Path(folder) / f"{name}.onnx").path for name in POLICIES
            ]
            return measure_deploy(files, seconds, time.process_time)

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
        "deploy": deploy,
        "places": places,
    }
    subjects = [options.what]
    if options.what == "all":
        subjects = [subject for subject in SUBJECTS if subject != "deploy" or _can_export()]
    return [row for subject in subjects for row in measures[subject]()]


def _can_export() -> bool:
    """Whether the packages of the extra `export` are there; say so if not."""
    missing = [name for name in ("onnx", "onnxscript", "onnxruntime") if find_spec(name) is None]
    if missing:
        print(f"Leaving out what=deploy, which needs {missing[0]}: pip install 'spin-rl[export]'")
    return not missing


def read_options(values: Mapping[str, Any], overrides: Sequence[str]) -> Options:
    """Reject what needs no simulator to reject, and make the folder of `out`.

    Raises:
        ConfigError: One line that names the key.
    """
    found = {"device": common.resolve_device(values["device"]), "overrides": tuple(overrides)}
    options = from_keys(Options, {**values, **found})
    from_mapping(Algorithm, values["algo"], "algo")
    if "teacher" in check_value(dict[str, Any], values["runner"].get("algorithm"), "runner.algorithm"):
        name = values["algo"]["name"]
        raise ConfigError(
            f"algo: {name} learns from a teacher, which is not measured; use cvo or direct_depth"
        )
    if options.device != "cpu" and options.processes > num_gpus():
        raise ConfigError(f"processes: {num_gpus()} GPUs found, one for each process is needed")
    NAV.configure(values)
    common.make_folder_of(options.out, "bench.json")

    from spin_rl.runners.config import check_config

    check_config(values["runner"], NAV.groups, options.num_envs)
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
