"""spin-train: train a policy by reinforcement learning, or continue a run."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import torch
import yaml
from omegaconf import DictConfig

from spin_rl.cli import common
from spin_rl.config import ConfigError
from spin_rl.runners.checkpoint import resolve_checkpoint, write_atomically
from spin_rl.tasks.build import env_config, plain


def main() -> None:
    """Entry point of the `spin-train` command."""
    common.run("train", train)


def train(cfg: DictConfig) -> None:
    """Run one training to its limit of iterations or minutes and write its summary.

    Writes `<run_dir>/config.yaml`, checkpoints, TensorBoard events and `summary.json`; with `evaluate=N` also the
    reach benchmark of the result.
    """
    from spin_rl.runners.ppo import PPORunner
    from spin_rl.tasks.nav import NavEnv

    values = plain(cfg)
    task = env_config(cfg)
    device = common.resolve_device(values["device"])
    rank = int(os.environ.get("RANK", "0"))
    seed = int(values["seed"])
    if device == "cpu" and "WORLD_SIZE" not in os.environ:
        torch.set_num_threads(1)
    torch.manual_seed(seed)

    run_dir = _run_dir(values)
    if common.is_main_process():
        _write_config(run_dir, values)
    with common.announced(f"Starting {values['num_envs']} worlds on {device}"):
        # Every process draws its own worlds.
        env = NavEnv(task, int(values["num_envs"]), device, seed=seed + 10_000 * rank)
    learning = values["runner"] | {"seed": seed}
    runner = PPORunner(env, learning, run_dir, device, snapshot=values)
    if values["resume"]:
        runner.load(resolve_checkpoint(values["resume"]))
    summary = runner.train(values["max_iterations"], values["max_minutes"])
    if not common.is_main_process():
        return
    summary |= {"device": device, "processes": int(os.environ.get("WORLD_SIZE", "1")), "seed": seed}
    path = run_dir / "summary.json"
    _write_text(path, json.dumps(summary, indent=2) + "\n")
    print(f"Wrote {path}: success {summary['success_rate']:.2f} after {summary['env_steps']:,} env steps")
    if values["evaluate"]:
        from spin_rl.benchmark.reach import evaluate_run

        evaluate_run(run_dir, episodes=int(values["evaluate"]), device=device)


def _run_dir(values: dict[str, Any]) -> Path:
    """The folder of this run: a resumed run stays in its own unless another is named."""
    path = Path(values["run_dir"])
    if values["resume"] is None and (path / "checkpoints" / "last.pt").exists():
        raise ConfigError(
            f"run_dir: {path} holds a run; continue it with resume={path} or name another folder"
        )
    path.mkdir(parents=True, exist_ok=True)
    return path


def _write_config(run_dir: Path, values: dict[str, Any]) -> None:
    _write_text(run_dir / "config.yaml", yaml.safe_dump(values, sort_keys=False))


def _write_text(path: Path, text: str) -> None:
    write_atomically(path, lambda file: file.write(text.encode()))


if __name__ == "__main__":
    main()
