"""spin-train: train a policy by reinforcement learning, or continue a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spin_rl.cli import common, run_folder
from spin_rl.cli.resume import to_keep, with_settings_of_run
from spin_rl.cli.task_choice import UNTRAINABLE
from spin_rl.config import ConfigError, from_mapping
from spin_rl.ranks import read_ranks
from spin_rl.tasks.common.compose import with_depth
from spin_rl.tasks.common.config import TaskConfig
from spin_rl.tasks.registry import TaskSpec, find_task

if TYPE_CHECKING:
    from spin_rl.runners.policy_file import TrainedPolicy


@dataclass(frozen=True, kw_only=True)
class Options(run_folder.RunOptions):
    """What a training call asks for, checked; `teacher` names the policy to learn from."""

    teacher: run_folder.SourceName | None


@dataclass(frozen=True)
class Algorithm:
    """The group `algo`, which changes others and has a name."""

    name: str


def main() -> None:
    """Entry point of the `spin-train` command."""
    common.run(
        "train",
        train,
        lambda given: (with_settings_of_run(given) or common.with_preset(given), None),
        common.keys_of(Options, common.GROUPS),
        UNTRAINABLE,
    )


def train(call: common.Call) -> bool:
    """Run one training to its limit of iterations or minutes and write its summary.

    Writes `<run_dir>/config.yaml`, checkpoints, TensorBoard events and `summary.json`; with `evaluate=N` also
    the result's benchmark. Bad settings are found before anything is written or compiled.
    """
    spec = find_task(call.values["task"].get("name"))
    spec.check(call.values)
    options, start = read_options(call.values, call.overrides)
    values = with_depth(call.values) | {"overrides": to_keep(call.overrides)}
    task = spec.configure(values)
    checkpoint = run_folder.find_start(options)
    with run_folder.claimed(options, checkpoint) as run_dir:
        with run_folder.videos(options, task, run_dir) as make_last_video:
            summary = _train(options, spec, task, values, start, checkpoint, run_dir)
        run_folder.write_results(run_dir, summary, options)
        if not run_folder.was_stopped(summary):
            make_last_video()
    return run_folder.was_stopped(summary)


def _train(
    options: Options,
    spec: TaskSpec,
    task: TaskConfig,
    values: dict[str, Any],
    start: TrainedPolicy | None,
    checkpoint: Path | None,
    run_dir: Path,
) -> dict[str, Any]:
    """Make worlds and models and train; return the summary."""
    import torch

    from spin_rl.runners.interface import Camera
    from spin_rl.runners.ppo.runner import PPORunner
    from spin_rl.runners.warm_start import warm_start

    ranks = read_ranks()
    if options.device == "cpu" and not ranks.parallel:
        torch.set_num_threads(1)
    torch.manual_seed(options.seed)

    with common.announced(f"Starting {options.num_envs} worlds on {options.device}"):
        # Every process draws its own worlds.
        env = spec.make_env(task, options.num_envs, options.device, options.seed + 10_000 * ranks.rank)
    learning = values["runner"] | {"seed": options.seed}
    runner = PPORunner(env, learning, run_dir, options.device, snapshot=values)
    if checkpoint is not None:
        run_folder.report_changes(runner.load(checkpoint), values)
    elif start is not None:
        message = warm_start(
            runner.alg,
            start,
            Camera.of(env),
            camera_pose=task.camera_pose,
            critic=_rewards_alike(start.config, values),
            camera_action=values["task"].get("camera_action", "target"),
        )
        if common.is_main_process():
            print(message + run_folder.range_note(start.config, values), flush=True)
    run_folder.write_config(run_dir, values)  # not before: a resume that is refused leaves the run as it was
    return runner.train(options.max_iterations, options.max_minutes)


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
    groups = find_task(values["task"].get("name")).groups
    from_mapping(Algorithm, values["algo"], "algo")
    sources = {"teacher": options.teacher, "init": options.init}
    for key, name in sources.items():
        if name is not None:
            run_folder.check_source(key, name)

    from spin_rl.runners.config import check_config, import_own_classes

    import_own_classes(values["runner"])
    check_config(values["runner"], groups, options.num_envs)
    return options, _open_sources(options, values)


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
