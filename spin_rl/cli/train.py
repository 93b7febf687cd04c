"""spin-train: train a policy by reinforcement learning, or continue a run."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from spin_rl.cli import common, run_folder
from spin_rl.cli.task_choice import UNTRAINABLE
from spin_rl.config import ConfigError
from spin_rl.tasks.common.compose import with_depth
from spin_rl.tasks.registry import find_task

if TYPE_CHECKING:
    from spin_rl.runners.policy_file import TrainedPolicy


@dataclass(frozen=True, kw_only=True)
class Options(run_folder.RunOptions):
    """What a training call asks for, checked; `teacher` names the policy to learn from."""

    teacher: run_folder.SourceName | None


def main() -> None:
    """Entry point of the `spin-train` command."""
    common.run(
        "train",
        train,
        lambda given: (common.with_preset(given), None),
        UNTRAINABLE,
    )


def train(call: common.Call) -> None:
    """Run one training to its limit of iterations or minutes and write its summary.

    Writes `<run_dir>/config.yaml`, checkpoints, TensorBoard events and `summary.json`; with `evaluate=N` also
    the result's benchmark. Bad settings are found before anything is written or compiled.
    """
    values = with_depth(call.values)
    spec = find_task(values["task"]["name"])
    task = spec.configure(values)
    options, start = read_options(values, call.overrides)

    import torch

    from spin_rl.runners.checkpoint import resolve_checkpoint
    from spin_rl.runners.interface import Camera
    from spin_rl.runners.ppo.runner import PPORunner
    from spin_rl.runners.warm_start import warm_start

    rank = int(os.environ.get("RANK", "0"))
    checkpoint = None if options.resume is None else resolve_checkpoint(options.resume)
    run_dir = run_folder.find(options, checkpoint)
    if options.device == "cpu" and "WORLD_SIZE" not in os.environ:
        torch.set_num_threads(1)
    torch.manual_seed(options.seed)

    with common.announced(f"Starting {options.num_envs} worlds on {options.device}"):
        # Every process draws its own worlds.
        env = spec.make_env(task, options.num_envs, options.device, options.seed + 10_000 * rank)
    learning = values["runner"] | {"seed": options.seed}
    runner = PPORunner(env, learning, run_dir, options.device, snapshot=values)
    if checkpoint is not None:
        run_folder.report_changes(runner.load(checkpoint), values)
    elif start is not None:
        message = warm_start(
            runner.alg,
            start,
            Camera.of(env),
            camera_is_frozen=task.camera_pose is not None,
            critic=_rewards_alike(start.config, values),
        )
        if common.is_main_process():
            print(message + run_folder.range_note(start.config, values), flush=True)
    run_folder.write_config(run_dir, values)  # not before: a resume that is refused leaves the run as it was
    summary = runner.train(options.max_iterations, options.max_minutes)
    run_folder.write_results(run_dir, summary, options)


def read_options(values: Mapping[str, Any], overrides: Sequence[str]) -> tuple[Options, TrainedPolicy | None]:
    """Reject what needs no simulator to reject, before kernels are compiled and files written.

    Args:
        values: Configuration of the run.
        overrides: Those of the command line.

    Returns:
        What was asked for, and the policy to start from.

    Raises:
        ValueError: One line that names the key.
    """
    options = run_folder.read_options(Options, values, overrides)
    start = _open_sources(options, values)
    groups = find_task(values["task"]["name"]).groups

    from spin_rl.runners.config import check_config

    check_config(values["runner"], groups, options.num_envs)
    return options, start


def _open_sources(options: Options, values: Mapping[str, Any]) -> TrainedPolicy | None:
    """Open the policy to start from, if there is one; reject a teacher that is missing, idle or of no use."""
    names = {"teacher": options.teacher, "init": options.init}
    opened = {key: run_folder.open_source(key, name) for key, name in names.items() if name is not None}
    has_teacher = "teacher" in values["runner"]["algorithm"]
    if has_teacher and options.teacher is None:
        raise ConfigError(
            f"teacher: algo={values['algo']['name']} learns from a policy of algo=dvo1a; "
            "teacher=<name, run, checkpoint or file>"
        )
    if not has_teacher and options.teacher is not None:
        raise ConfigError(
            f"teacher: algo={values['algo']['name']} has none; to start from a policy's weights use init="
        )
    if has_teacher:
        from spin_rl.runners.ppo.dvo import check_teacher

        check_teacher(opened["teacher"])
    return opened.get("init")


def _rewards_alike(trained: Mapping[str, Any], values: Mapping[str, Any]) -> bool:
    """Whether the policy to start from was trained on the same reward, so that its critic knows its worth."""
    return trained.get("reward") == values["reward"] and _task_reward(values) == _task_reward(trained)


def _task_reward(values: Mapping[str, Any]) -> float:
    return values["runner"]["algorithm"].get("task_reward", 1.0)


if __name__ == "__main__":
    main()
