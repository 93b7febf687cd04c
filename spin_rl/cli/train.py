"""spin-train: train a policy by reinforcement learning, or continue a run."""

from __future__ import annotations

import os
import sys
from typing import Any

import torch
from omegaconf import DictConfig

from spin_rl.cli import common, run_folder
from spin_rl.cli.task_choice import UNTRAINABLE
from spin_rl.config import ConfigError
from spin_rl.runners.checkpoint import resolve_checkpoint
from spin_rl.runners.config import check_config
from spin_rl.runners.interface import Camera
from spin_rl.runners.policy_file import read_policy
from spin_rl.runners.ppo.dvo import check_teacher
from spin_rl.runners.warm_start import warm_start
from spin_rl.tasks.common.compose import plain, with_depth
from spin_rl.tasks.registry import find_task


def main() -> None:
    """Entry point of the `spin-train` command."""
    sys.argv[1:] = common.with_preset(sys.argv[1:], torch.cuda.is_available())
    common.run("train", train, UNTRAINABLE)


def train(cfg: DictConfig) -> None:
    """Run one training to its limit of iterations or minutes and write its summary.

    Writes `<run_dir>/config.yaml`, checkpoints, TensorBoard events and `summary.json`; with `evaluate=N` also
    the result's benchmark. Bad settings are found before anything is written or compiled.
    """
    from spin_rl.runners.ppo.runner import PPORunner

    values = with_depth(plain(cfg))
    spec = find_task(values["task"]["name"])
    task = spec.configure(values)
    _check(values)
    device = common.resolve_device(values["device"])
    rank = int(os.environ.get("RANK", "0"))
    seed = values["seed"]
    checkpoint = None if values["resume"] is None else resolve_checkpoint(values["resume"])
    run_dir = run_folder.find(values, checkpoint)
    if device == "cpu" and "WORLD_SIZE" not in os.environ:
        torch.set_num_threads(1)
    torch.manual_seed(seed)

    with common.announced(f"Starting {values['num_envs']} worlds on {device}"):
        # Every process draws its own worlds.
        env = spec.make_env(task, values["num_envs"], device, seed + 10_000 * rank)
    learning = values["runner"] | {"seed": seed}
    runner = PPORunner(env, learning, run_dir, device, snapshot=values)
    if checkpoint is not None:
        run_folder.report_changes(runner.load(checkpoint), values)
    elif values["init"] is not None:
        message = warm_start(
            runner.alg,
            values["init"],
            Camera.of(env),
            camera_is_frozen=task.camera_pose is not None,
            critic=_rewards_alike(values),
        )
        if common.is_main_process():
            print(message + run_folder.range_note(values["init"], values), flush=True)
    run_folder.write_config(run_dir, values)  # not before: a resume that is refused leaves the run as it was
    summary = runner.train(values["max_iterations"], values["max_minutes"])
    run_folder.write_results(run_dir, summary, values, device)


def _check(values: dict[str, Any]) -> None:
    """Reject what needs no simulator to reject, before kernels are compiled and files written."""
    run_folder.check_call(values)
    _check_sources(values)
    groups = find_task(values["task"]["name"]).groups
    check_config(values["runner"], dict.fromkeys(groups), values["num_envs"])


def _check_sources(values: dict[str, Any]) -> None:
    """Reject policies to start or learn from that do not exist, or cannot teach."""
    for key in ("teacher", "init"):
        if values[key] is not None:
            run_folder.policy_metadata(key, values[key])
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


if __name__ == "__main__":
    main()
