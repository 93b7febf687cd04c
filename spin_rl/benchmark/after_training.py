"""The reach benchmark of what a training has just made."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from pathlib import Path

from spin_rl.benchmark import policies, report, settings
from spin_rl.benchmark.reach import REACH_CELLS, evaluate_reach
from spin_rl.tasks.build import env_config


def evaluate_run(
    run_dir: Path,
    episodes: int,
    device: str,
    seeds: Sequence[int] = (0,),
    announce: Callable[[str], contextlib.AbstractContextManager] | None = None,
    overrides: Sequence[str] = (),
) -> Path:
    """Evaluate the last checkpoint of a run, print the table and write `<run_dir>/reach.json`.

    The corridors and the noise of depth images are those of the training call, everything else is nominal.

    Args:
        run_dir: Folder of a training run.
        episodes: Episodes per cell and seed.
        device: "cpu" or "cuda:N".
        seeds: Seeds of the corridors.
        announce: Context in which the worlds are made, such as `common.announced`.
        overrides: Those of the training's command line.

    Returns:
        The file.
    """
    make_policy, trained = policies.open_policy(str(run_dir))
    conditions = settings.conditions(overrides)
    cfg = settings.for_policy(settings.compose(conditions), trained, conditions)
    print(f"Evaluating {run_dir} in {len(REACH_CELLS)} cells")
    result = evaluate_reach(
        make_policy, env_config(cfg), episodes, seeds, device, policy_name=str(run_dir), announce=announce
    )
    label = settings.scene_label(conditions)
    if label is not None:
        result["scene"] = label
    print(report.table(result))
    path = Path(run_dir) / "reach.json"
    report.write_json(result, path)
    print(f"Wrote {path}: {report.headline(result)}")
    return path
