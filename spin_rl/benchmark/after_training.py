"""The benchmark of what a training has just made."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from pathlib import Path

from spin_rl.benchmark import policies, settings
from spin_rl.benchmark import registry as benchmarks
from spin_rl.files import write_json
from spin_rl.tasks.common.compose import compose
from spin_rl.tasks.registry import find_task


def evaluate_run(
    run_dir: Path,
    episodes: int,
    device: str,
    seeds: Sequence[int] = (0,),
    announce: Callable[[str], contextlib.AbstractContextManager] | None = None,
    overrides: Sequence[str] = (),
) -> Path:
    """Evaluate the last checkpoint of a run, print the table and write `<run_dir>/<benchmark>.json`.

    The benchmark is that of the policy's task. Scenes and the noise of depth images are those of the training
    call, everything else is nominal.

    Args:
        run_dir: Folder of a training run.
        episodes: Episodes per seed, of the reach benchmark per cell and seed.
        device: "cpu" or "cuda:N".
        seeds: Seeds of the scenes.
        announce: Context in which the worlds are made, such as `common.announced`.
        overrides: Those of the training's command line.

    Returns:
        The file.
    """
    source = policies.open_policy(str(run_dir))
    task = find_task(source.task or "nav")
    conditions = settings.conditions(overrides)
    cfg = settings.for_policy(compose("eval", [f"task={task.name}", *conditions]), source.trained, conditions)
    benchmark = benchmarks.find(None, task.name, families="shares" in cfg["scene"])
    print(f"Evaluating {run_dir}: {benchmark.name}")
    result = benchmark.evaluate(
        source.make,
        task.configure(cfg),
        episodes,
        seeds,
        device,
        policy_name=str(run_dir),
        announce=announce,
    )
    label = settings.scene_label(conditions, benchmark.scene)
    if label is not None:
        result["scene"] = label
    print(benchmark.table(result))
    path = Path(run_dir) / f"{benchmark.name}.json"
    write_json(path, result)
    print(f"Wrote {path}: {benchmark.headline(result)}")
    return path
