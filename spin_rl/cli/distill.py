"""spin-distill: turn a policy that sees scandots, or the object, into one that sees depth."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from spin_rl.benchmark import settings
from spin_rl.benchmark.policies import check_task
from spin_rl.cli import common, run_folder, task_choice
from spin_rl.cli.resume import to_keep, with_settings_of_run
from spin_rl.config import Choice, ConfigError, check_value
from spin_rl.ranks import read_ranks
from spin_rl.tasks.common.compose import with_depth
from spin_rl.tasks.common.config import TaskConfig
from spin_rl.tasks.registry import TaskSpec, find_task

if TYPE_CHECKING:
    from spin_rl.runners.distillation.runner import DistillRunner
    from spin_rl.runners.policy_file import TrainedPolicy
    from spin_rl.tasks.common.env import TaskEnv

MODES = ("sync", "async")


@dataclass(frozen=True, kw_only=True)
class Options(run_folder.RunOptions):
    """What a call asks for, checked; `teacher` names the policy to learn from, `mode` is one of `MODES`."""

    teacher: run_folder.SourceName
    mode: Annotated[str, Choice(MODES)]


def main() -> None:
    """Entry point of the `spin-distill` command."""

    def complete(given: list[str]) -> common.Completed:
        given = with_settings_of_run(given) or common.with_preset(given, "distill_preset")
        return task_choice.with_task(given, "teacher")

    keys = common.keys_of(Options, common.GROUPS - {"algo"})
    common.run("distill", distill, complete, keys, task_choice.UNTRAINABLE)


def distill(call: common.Call) -> bool:
    """Run one distillation to its limit of iterations or minutes and write its summary.

    Writes into the run's folder what `spin-train` does. Bad settings are found before anything is written or
    compiled.
    """
    options = run_folder.read_options(Options, call.values, call.overrides)
    if options.mode == "async" and read_ranks().parallel:
        raise ConfigError("mode: async has two processes of its own; under torchrun use sync")
    find_task(call.values["task"].get("name")).check(call.values)
    teacher = run_folder.open_source("teacher", options.teacher)
    start = None if options.init is None else run_folder.open_source("init", options.init)
    values = _configure(call, options, teacher)
    spec = find_task(values["task"]["name"])
    task = spec.configure(values)
    checkpoint = run_folder.find_start(options)
    ranks = read_ranks()
    make = partial(make_env, spec, task, options.num_envs, options.device, options.seed + 10_000 * ranks.rank)
    with run_folder.claimed(options, checkpoint) as run_dir:
        with run_folder.videos(options, task, run_dir) as make_last_video:
            summary = _train(options, make, values, start, checkpoint, run_dir)
        run_folder.write_results(run_dir, summary, options)
        if not run_folder.was_stopped(summary):
            make_last_video()
    return run_folder.was_stopped(summary)


def _train(
    options: Options,
    make: Callable[[], TaskEnv],
    values: dict[str, Any],
    start: TrainedPolicy | None,
    checkpoint: Path | None,
    run_dir: Path,
) -> dict[str, Any]:
    """Make worlds and models and train; return the summary."""
    import torch

    from spin_rl.runners.remote.runner import CollectorError

    if options.device == "cpu" and not read_ranks().parallel:
        torch.set_num_threads(1)
    torch.manual_seed(options.seed)
    try:
        with closing(_make_runner(options, make, run_dir, values)) as runner:
            if checkpoint is not None:
                run_folder.report_changes(runner.load(checkpoint), values)
            elif start is not None:
                _start_from(runner, start, run_folder.range_note(start.config, values))
            run_folder.write_config(run_dir, values)
            return runner.train(options.max_iterations, options.max_minutes)
    except CollectorError as error:
        sys.exit(f"spin-distill: error: {error}")


def _start_from(runner: DistillRunner, source: TrainedPolicy, note: str = "") -> None:
    """Let the student begin as another policy, one that sees what it sees or what its teacher does.

    Args:
        runner: The run, with a new student.
        source: The policy.
        note: What is said of it besides.

    Raises:
        ConfigError: It does not fit; one line that says why.
    """
    from spin_rl.runners.interface import Camera
    from spin_rl.runners.model_copy import copy_model

    try:
        notes = copy_model(runner.alg.student, source.build(), Camera())
    except ValueError as error:
        raise ConfigError(f"init: {source.name} cannot start the student: {error}") from None
    if common.is_main_process():
        print(f"Initialized from {source.name}: {notes}{note}", flush=True)


def make_env(spec: TaskSpec, task: TaskConfig, num_envs: int, device: str, seed: int) -> TaskEnv:
    """Make the worlds, in whichever process they are wanted."""
    with common.announced(f"Starting {num_envs} worlds on {device}"):
        return spec.make_env(task, num_envs, device, seed)


def _make_runner(
    options: Options, make: Callable[[], TaskEnv], run_dir: Path, values: dict[str, Any]
) -> DistillRunner:
    from spin_rl.runners.distillation.runner import DistillRunner
    from spin_rl.runners.remote.runner import AsyncDistillRunner, RemoteEnv

    learning = values["runner"] | {"seed": options.seed}
    if options.mode == "sync":
        return DistillRunner(make(), learning, run_dir, options.device, snapshot=values)
    env = RemoteEnv(make, options.device)
    try:
        return AsyncDistillRunner(env, learning, run_dir, options.device, snapshot=values)
    except BaseException:
        env.close()
        raise


def _configure(call: common.Call, options: Options, teacher: TrainedPolicy) -> dict[str, Any]:
    """Return the run's configuration: fill in what the teacher says, and check what the student learns by."""
    from spin_rl.runners.distillation.runner import check_distillation
    from spin_rl.runners.distillation.student import student_config

    values = settings.for_policy(call.values, teacher.config, options.overrides)
    spec = find_task(values["task"]["name"])
    own = teacher.config.get("task", {}).get("name")
    check_task("teacher", teacher.name, own, spec.name, spec.name)
    runner = dict(values["runner"])
    further = check_value(tuple[str, ...], runner.pop("further_groups", None), "runner.further_groups")
    encoder = check_value(dict[str, Any], runner.pop("depth_encoder", None), "runner.depth_encoder")
    runner |= student_config(teacher.metadata, encoder, further)
    check_distillation(runner, spec.groups, options.num_envs)
    return with_depth(values | {"runner": runner, "overrides": to_keep(options.overrides)})


if __name__ == "__main__":
    main()
