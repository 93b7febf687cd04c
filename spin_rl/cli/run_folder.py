"""What the training commands share: the options of a call, the run's folder and what is written there."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import yaml
from hydra.core.hydra_config import HydraConfig

from spin_rl.cli import common
from spin_rl.config import ConfigError
from spin_rl.files import write_text
from spin_rl.runners.policy_file import read_policy

# Settings of a call rather than of the run.
_PER_CALL = ("resume", "init", "run_dir", "max_minutes", "max_iterations", "evaluate", "device", "seed")


def check_call(values: dict[str, Any]) -> None:
    """Reject numbers and paths that need no simulator to reject.

    Raises:
        ConfigError: One line that names the key.
    """
    for key, least in (("num_envs", 1), ("seed", 0), ("max_iterations", 1), ("evaluate", 0)):
        value = values[key]
        if type(value) is not int or value < least:
            raise ConfigError(f"{key}: expected a whole number from {least} on, got {value!r}")
    minutes = values["max_minutes"]
    if minutes is not None and (type(minutes) not in (int, float) or not 0.0 < minutes < math.inf):
        raise ConfigError(f"max_minutes: expected a positive number or null, got {minutes!r}")
    for key in ("run_dir", "resume"):
        if not isinstance(values[key], str) and not (key == "resume" and values[key] is None):
            raise ConfigError(f"{key}: expected a path, got {values[key]!r}")


def policy_metadata(key: str, source: object) -> dict[str, Any]:
    """Read what the policy that a setting names says of itself; see `policy_file.read_policy`.

    Raises:
        ConfigError: There is none; one line that names the key.
    """
    if not isinstance(source, str):
        raise ConfigError(f"{key}: expected the name or path of a policy, got {source!r}")
    try:
        return read_policy(source)[1]
    except (FileNotFoundError, ValueError) as error:
        raise ConfigError(f"{key}: {error}") from None


def find(values: dict[str, Any], checkpoint: Path | None) -> Path:
    """Return the folder of this run: a resumed run stays in its own unless another is named.

    Raises:
        ConfigError: Another run is in it.
    """
    named = any(override.startswith("run_dir=") for override in HydraConfig.get().overrides.task)
    if checkpoint is not None and checkpoint.parent.name == "checkpoints" and not named:
        return checkpoint.parent.parent
    path = Path(values["run_dir"])
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


def range_note(source: str, values: dict[str, Any]) -> str:
    """Say that the policy to start from read depths in another range than this run has; empty if not."""
    trained = read_policy(source)[1]["config"] or {}
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


def write_results(run_dir: Path, summary: dict[str, Any], values: dict[str, Any], device: str) -> None:
    """Write `summary.json` and, if the call asks for it, evaluate; only the main process does."""
    if not common.is_main_process():
        return
    processes = int(os.environ.get("WORLD_SIZE", "1"))
    summary = summary | {"device": device, "processes": processes, "seed": values["seed"]}
    path = run_dir / "summary.json"
    # JSON has no NaN: rates of no episodes are null.
    plain = {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in summary.items()}
    write_text(path, json.dumps(plain, indent=2, allow_nan=False) + "\n")
    success = summary["success_rate"]
    result = "no episode over yet" if math.isnan(success) else f"success {success:.2f}"
    print(f"Wrote {path}: {result} after {summary['env_steps']:,} env steps")
    if values["evaluate"]:
        from spin_rl.benchmark.after_training import evaluate_run

        evaluate_run(
            run_dir,
            episodes=values["evaluate"],
            device=device,
            announce=common.announced,
            overrides=HydraConfig.get().overrides.task,
        )
