"""spin-distill: turn a policy that sees scandots, or the object, into one that sees depth."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import torch
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from spin_rl.benchmark import settings
from spin_rl.cli import common, run_folder, task_choice
from spin_rl.config import ConfigError
from spin_rl.runners.checkpoint import resolve_checkpoint
from spin_rl.runners.distillation.algorithm import student_config
from spin_rl.runners.distillation.runner import DistillRunner, check_distillation
from spin_rl.runners.interface import Camera
from spin_rl.runners.policy_file import load_policy
from spin_rl.runners.remote.runner import AsyncDistillRunner, CollectorError, RemoteEnv
from spin_rl.runners.warm_start import copy_model
from spin_rl.tasks.common.compose import plain, with_depth
from spin_rl.tasks.common.config import TaskConfig
from spin_rl.tasks.common.env import TaskEnv
from spin_rl.tasks.registry import TaskSpec, find_task

MODES = ("sync", "async")


def main() -> None:
    """Entry point of the `spin-distill` command."""
    arguments = common.with_preset(sys.argv[1:], torch.cuda.is_available(), "distill_preset")
    sys.argv[1:] = task_choice.with_task(arguments, "teacher")
    common.run("distill", distill, task_choice.UNTRAINABLE)


def distill(cfg: DictConfig) -> None:
    """Run one distillation to its limit of iterations or minutes and write its summary.

    Writes into the run's folder what `spin-train` does. Bad settings are found before anything is written or
    compiled.
    """
    values = _configure(cfg)
    spec = find_task(values["task"]["name"])
    task = spec.configure(values)
    device = common.resolve_device(values["device"])
    rank = int(os.environ.get("RANK", "0"))
    seed = values["seed"]
    checkpoint = None if values["resume"] is None else resolve_checkpoint(values["resume"])
    run_dir = run_folder.find(values, checkpoint)
    if device == "cpu" and "WORLD_SIZE" not in os.environ:
        torch.set_num_threads(1)
    torch.manual_seed(seed)

    make = partial(make_env, spec, task, values["num_envs"], device, seed + 10_000 * rank)
    learning = values["runner"] | {"seed": seed}
    try:
        with closing(_make_runner(values["mode"], make, learning, run_dir, device, values)) as runner:
            if checkpoint is not None:
                run_folder.report_changes(runner.load(checkpoint), values)
            elif values["init"] is not None:
                _start_from(runner, values["init"], run_folder.range_note(values["init"], values))
            run_folder.write_config(run_dir, values)
            summary = runner.train(values["max_iterations"], values["max_minutes"])
    except CollectorError as error:
        sys.exit(f"spin-distill: error: {error}")
    run_folder.write_results(run_dir, summary, values, device)


def _start_from(runner: DistillRunner, source: str, note: str = "") -> None:
    """Let the student begin as another policy, one that sees what it sees or what its teacher does.

    Args:
        runner: The run, with a new student.
        source: The policy.
        note: What is said of it besides.

    Raises:
        ConfigError: It does not fit; one line that says why.
    """
    try:
        notes = copy_model(runner.alg.student, load_policy(source), Camera())
    except ValueError as error:
        raise ConfigError(f"init: {source} cannot start the student: {error}") from None
    if common.is_main_process():
        print(f"Initialized from {source}: {notes}{note}", flush=True)


def make_env(spec: TaskSpec, task: TaskConfig, num_envs: int, device: str, seed: int) -> TaskEnv:
    """Make the worlds, in whichever process they are wanted."""
    with common.announced(f"Starting {num_envs} worlds on {device}"):
        return spec.make_env(task, num_envs, device, seed)


def _make_runner(
    mode: str,
    make: Callable[[], TaskEnv],
    learning: dict[str, Any],
    run_dir: Path,
    device: str,
    values: dict[str, Any],
) -> DistillRunner:
    if mode == "sync":
        return DistillRunner(make(), learning, run_dir, device, snapshot=values)
    env = RemoteEnv(make, device)
    try:
        return AsyncDistillRunner(env, learning, run_dir, device, snapshot=values)
    except BaseException:
        env.close()
        raise


def _configure(cfg: DictConfig) -> dict[str, Any]:
    """Fill in what the teacher says, and reject what needs no simulator to reject."""
    source = cfg.teacher
    teacher = run_folder.policy_metadata("teacher", source)
    if cfg.init is not None:
        run_folder.policy_metadata("init", cfg.init)
    values = plain(settings.for_policy(cfg, teacher["config"], HydraConfig.get().overrides.task))
    task = values["task"]["name"]
    task_choice.check_task(source, teacher["config"], task, "teacher")
    run_folder.check_call(values)
    if values["mode"] not in MODES:
        raise ConfigError(f"mode: expected one of {', '.join(MODES)}, got {values['mode']!r}")
    if values["mode"] == "async" and os.environ.get("WORLD_SIZE", "1") != "1":
        raise ConfigError("mode: async has two processes of its own; under torchrun use sync")
    runner = dict(values["runner"])
    runner |= student_config(teacher, runner.pop("depth_encoder"), runner.pop("further_groups"))
    check_distillation(runner, dict.fromkeys(find_task(task).groups), values["num_envs"])
    return with_depth(values | {"runner": runner})


if __name__ == "__main__":
    main()
