"""What the training commands share: the options of a call, the run's folder and what is written there."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import yaml

from spin_rl.cli import common
from spin_rl.config import POSITIVE, ConfigError, Means, Range, from_keys
from spin_rl.files import write_text
from spin_rl.policy import find_policy

if TYPE_CHECKING:
    from spin_rl.runners.policy_file import TrainedPolicy

SourceName = Annotated[str, Means("the name or path of a policy")]

# Settings of a call rather than of the run.
_PER_CALL = ("resume", "init", "run_dir", "max_minutes", "max_iterations", "evaluate", "device", "seed")


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """What a training call asks for beside the run's own settings, checked.

    Attributes:
        num_envs: Worlds of each process.
        seed: Of weights and worlds.
        max_iterations: Last iteration.
        max_minutes: Wall-clock limit of the call, or None.
        run_dir: Folder of the run.
        resume: Run folder or checkpoint to continue, or None.
        init: Policy whose weights to start from, or None.
        evaluate: Episodes of the benchmark after training; 0 for none.
        device: "cpu" or "cuda:N".
        overrides: Those of the command line.
    """

    num_envs: Annotated[int, Range(1)]
    seed: Annotated[int, Range(0)]
    max_iterations: Annotated[int, Range(1)]
    max_minutes: Annotated[float, POSITIVE] | None
    run_dir: Path
    resume: Path | None
    init: SourceName | None
    evaluate: Annotated[int, Range(0)]
    device: str
    overrides: tuple[str, ...]


Options = TypeVar("Options", bound=RunOptions)


def read_options(kind: type[Options], values: Mapping[str, Any], overrides: Sequence[str]) -> Options:
    """Reject numbers and paths that need no simulator to reject.

    Args:
        kind: The command's options.
        values: Composed configuration.
        overrides: Those of the command line.

    Raises:
        ConfigError: One line that names the key.
    """
    device = common.resolve_device(values["device"])
    return from_keys(kind, {**values, "device": device, "overrides": tuple(overrides)})


def open_source(key: str, name: str) -> TrainedPolicy:
    """Read the policy that a setting names; see `policy_file.read_policy`.

    Raises:
        ConfigError: There is none; one line that names the key.
    """
    try:
        find_policy(name)  # before Torch is imported
        from spin_rl.runners.policy_file import read_policy

        return read_policy(name)
    except (FileNotFoundError, ValueError) as error:
        raise ConfigError(f"{key}: {error}") from None


def find(options: RunOptions, checkpoint: Path | None) -> Path:
    """Return the folder of this run: a resumed run stays in its own unless another is named.

    Raises:
        ConfigError: Another run is in it.
    """
    named = any(override.startswith("run_dir=") for override in options.overrides)
    if checkpoint is not None and checkpoint.parent.name == "checkpoints" and not named:
        return checkpoint.parent.parent
    path = options.run_dir
    if checkpoint is None and (path / "checkpoints" / "last.pt").exists():
        raise ConfigError(
            f"run_dir: {path} holds a run; continue it with resume={path} or name another folder"
        )
    if common.is_main_process():
        path.mkdir(parents=True, exist_ok=True)  # a folder that cannot be made is found before anything else
    return path


def report_changes(state: dict[str, Any], values: dict[str, Any]) -> None:
    """Name the settings of a resumed run that differ from its checkpoint's."""
    changed = _changed_settings(json.loads(state["config"])["run"], values)
    if changed and common.is_main_process():
        print(f"Continuing with other settings than before: {', '.join(changed)}", flush=True)


def range_note(trained: Mapping[str, Any], values: Mapping[str, Any]) -> str:
    """Say that the policy to start from read depths in another range than this run has; empty if not.

    Args:
        trained: Configuration of the policy's training.
        values: That of this run.
    """
    if not all(run.get("task", {}).get("depth", {}).get("enabled") for run in (trained, values)):
        return ""
    then, now = ([run["depth"]["filter"][name] for name in ("near_m", "far_m")] for run in (trained, values))
    if then == now:
        return ""
    return f"; it read depths of {then[0]} to {then[1]} m, here they are {now[0]} to {now[1]} m"


def _changed_settings(before: Any, now: Any, path: str = "") -> list[str]:
    """List settings that differ as `key=value`."""
    if isinstance(before, dict) and isinstance(now, dict):
        keys = [key for key in now if path or key not in _PER_CALL]
        return [
            line
            for key in keys
            for line in _changed_settings(before.get(key), now[key], f"{path}.{key}" if path else key)
        ]
    return [] if before == now else [f"{path}={now}"]


def write_config(run_dir: Path, values: dict[str, Any]) -> None:
    """Write `config.yaml`; only the main process does."""
    if common.is_main_process():
        write_text(run_dir / "config.yaml", yaml.safe_dump(values, sort_keys=False))


def write_results(run_dir: Path, summary: dict[str, Any], options: RunOptions) -> None:
    """Write `summary.json` and, if the call asks for it, evaluate; only the main process does."""
    if not common.is_main_process():
        return
    processes = int(os.environ.get("WORLD_SIZE", "1"))
    summary = summary | {"device": options.device, "processes": processes, "seed": options.seed}
    path = run_dir / "summary.json"
    # JSON has no NaN: rates of no episodes are null.
    plain = {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in summary.items()}
    write_text(path, json.dumps(plain, indent=2, allow_nan=False) + "\n")
    success = summary["success_rate"]
    result = "no episode over yet" if math.isnan(success) else f"success {success:.2f}"
    print(f"Wrote {path}: {result} after {summary['env_steps']:,} env steps")
    if options.evaluate:
        from spin_rl.benchmark.after_training import evaluate_run

        evaluate_run(
            run_dir,
            episodes=options.evaluate,
            device=options.device,
            announce=common.announced,
            overrides=options.overrides,
        )
