"""spin-train: train a policy by reinforcement learning, or continue a run."""

from __future__ import annotations

import json
import math
import os
import sys
from pathlib import Path
from typing import Any

import torch
import yaml
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from spin_rl.cli import common
from spin_rl.config import ConfigError
from spin_rl.runners.checkpoint import resolve_checkpoint, write_atomically
from spin_rl.runners.config import check_config
from spin_rl.runners.dvo import check_teacher
from spin_rl.runners.interface import Camera
from spin_rl.runners.policy_file import read_policy
from spin_rl.runners.warm_start import warm_start
from spin_rl.tasks.build import env_config, plain
from spin_rl.tasks.observations import GROUPS


def main() -> None:
    """Entry point of the `spin-train` command."""
    sys.argv[1:] = common.with_preset(sys.argv[1:], torch.cuda.is_available())
    common.run("train", train)


def train(cfg: DictConfig) -> None:
    """Run one training to its limit of iterations or minutes and write its summary.

    Writes `<run_dir>/config.yaml`, checkpoints, TensorBoard events and `summary.json`; with `evaluate=N` also
    the reach benchmark of the result. Bad settings are found before anything is written or compiled.
    """
    from spin_rl.runners.ppo import PPORunner
    from spin_rl.tasks.nav import NavEnv

    values = plain(cfg)
    task = env_config(cfg)
    _check(values)
    device = common.resolve_device(values["device"])
    rank = int(os.environ.get("RANK", "0"))
    seed = values["seed"]
    checkpoint = None if values["resume"] is None else resolve_checkpoint(values["resume"])
    run_dir = _run_dir(values, checkpoint)
    if device == "cpu" and "WORLD_SIZE" not in os.environ:
        torch.set_num_threads(1)
    torch.manual_seed(seed)

    with common.announced(f"Starting {values['num_envs']} worlds on {device}"):
        # Every process draws its own worlds.
        env = NavEnv(task, values["num_envs"], device, seed=seed + 10_000 * rank)
    learning = values["runner"] | {"seed": seed}
    runner = PPORunner(env, learning, run_dir, device, snapshot=values)
    if checkpoint is not None:
        state = runner.load(checkpoint)
        changed = _changed_settings(json.loads(state["config"])["run"], values)
        if changed and common.is_main_process():
            print(f"Continuing with other settings than before: {', '.join(changed)}", flush=True)
    elif values["init"] is not None:
        message = warm_start(
            runner.alg,
            values["init"],
            Camera.of(env),
            camera_is_frozen=task.camera_pose is not None,
            critic=_rewards_alike(values),
        )
        if common.is_main_process():
            print(message, flush=True)
    if common.is_main_process():
        _write_config(run_dir, values)  # not before: a resume that is refused leaves the run as it was
    summary = runner.train(values["max_iterations"], values["max_minutes"])
    if not common.is_main_process():
        return
    summary |= {"device": device, "processes": int(os.environ.get("WORLD_SIZE", "1")), "seed": seed}
    path = run_dir / "summary.json"
    # JSON has no NaN: rates of no episodes are null.
    plain_summary = {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in summary.items()}
    _write_text(path, json.dumps(plain_summary, indent=2, allow_nan=False) + "\n")
    print(f"Wrote {path}: success {summary['success_rate']:.2f} after {summary['env_steps']:,} env steps")
    if values["evaluate"]:
        from spin_rl.benchmark.reach import evaluate_run

        evaluate_run(run_dir, episodes=values["evaluate"], device=device, announce=common.announced)


def _check(values: dict[str, Any]) -> None:
    """Reject what needs no simulator to reject, before kernels are compiled and files written."""
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
    _check_sources(values)
    check_config(values["runner"], dict.fromkeys(GROUPS), values["num_envs"])


def _check_sources(values: dict[str, Any]) -> None:
    """Reject policies to start or learn from that do not exist, or cannot teach."""
    for key in ("teacher", "init"):
        value = values[key]
        if value is None:
            continue
        if not isinstance(value, str):
            raise ConfigError(f"{key}: expected the name or path of a policy, got {value!r}")
        try:
            read_policy(value)
        except (FileNotFoundError, ValueError) as error:
            raise ConfigError(f"{key}: {error}") from None
    has_teacher = "teacher" in values["runner"]["algorithm"]
    if has_teacher and values["teacher"] is None:
        raise ConfigError(
            f"teacher: algo={values['algo']['name']} learns from a policy of algo=dvo1a; "
            "teacher=<name, run, checkpoint or file>"
        )
    if not has_teacher and values["teacher"] is not None:
        raise ConfigError(
            f"teacher: algo={values['algo']['name']} has none; to start from a policy's weights use init="
        )
    if has_teacher:
        check_teacher(values["teacher"])


def _rewards_alike(values: dict[str, Any]) -> bool:
    """Whether the policy to start from was trained on the same reward, so that its critic knows its worth."""
    trained = read_policy(values["init"])[1]["config"]
    return (trained or {}).get("reward") == values["reward"] and _task_reward(values) == _task_reward(trained)


def _task_reward(values: dict[str, Any]) -> float:
    return values["runner"]["algorithm"].get("task_reward", 1.0)


def _run_dir(values: dict[str, Any], checkpoint: Path | None) -> Path:
    """The folder of this run: a resumed run stays in its own unless another is named."""
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


# Settings of a call rather than of the run.
_PER_CALL = ("resume", "init", "run_dir", "max_minutes", "max_iterations", "evaluate", "device", "seed")


def _changed_settings(before: Any, now: Any, path: str = "") -> list[str]:
    """Name the settings of a resumed run that differ from its checkpoint's, as `key=value`."""
    if isinstance(before, dict) and isinstance(now, dict):
        keys = [key for key in now if path or key not in _PER_CALL]
        return [
            line
            for key in keys
            for line in _changed_settings(before.get(key), now[key], f"{path}.{key}" if path else key)
        ]
    return [] if before == now else [f"{path}={now}"]


def _write_config(run_dir: Path, values: dict[str, Any]) -> None:
    _write_text(run_dir / "config.yaml", yaml.safe_dump(values, sort_keys=False))


def _write_text(path: Path, text: str) -> None:
    write_atomically(path, lambda file: file.write(text.encode()))


if __name__ == "__main__":
    main()
