"""What the training commands share: the options of a call, the run's folder and what is written there."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import yaml

from spin_rl.cli import common
from spin_rl.cli.resume import PER_CALL
from spin_rl.cli.videos import made_on_the_way
from spin_rl.config import ConfigError, Means, Range, from_keys
from spin_rl.extras import require
from spin_rl.files import reason, remove_temporary, write_json, write_text
from spin_rl.policy import find_policy
from spin_rl.ranges import Count, Minutes, NumEnvs, Seed
from spin_rl.ranks import read_ranks
from spin_rl.tasks.common.config import TaskConfig

if TYPE_CHECKING:
    from spin_rl.runners.policy_file import TrainedPolicy

SourceName = Annotated[str, Means("the name or path of a policy")]

LIMITS = ("max_iterations", "max_minutes")

# Settings whose change is nothing to tell of.
_NOT_TOLD = (*PER_CALL, "device", "seed", "overrides")


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
        video_minutes: Time between videos of the latest policy [min], or None.
        device: "cpu" or "cuda:N".
        overrides: Those of the command line.
    """

    num_envs: NumEnvs
    seed: Seed
    max_iterations: Count
    max_minutes: Minutes | None
    run_dir: Path
    resume: Path | None
    init: SourceName | None
    evaluate: Annotated[int, Range(0, 1_000_000)]
    video_minutes: Minutes | None
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
    if values["video_minutes"] is not None:
        for module, package in (("imageio_ffmpeg", "imageio[ffmpeg]"), ("PIL", "pillow")):
            require(module, package, "viewer", "video_minutes")
    if dict(values["runner"]).get("wandb_project") is not None:
        require("wandb", "wandb", "wandb", "runner.wandb_project")
    return from_keys(kind, {**values, "device": device, "overrides": tuple(overrides)})


def open_source(key: str, name: str) -> TrainedPolicy:
    """Read the policy that a setting names; see `policy_file.read_policy`.

    Raises:
        ConfigError: There is none; one line that names the key.
    """
    check_source(key, name)
    from spin_rl.runners.policy_file import read_policy

    try:
        return read_policy(name)
    except (FileNotFoundError, ValueError) as error:
        raise ConfigError(f"{key}: {error}") from None


def check_source(key: str, name: str) -> None:
    """Reject the name of a policy that there is none of, before Torch is imported.

    Raises:
        ConfigError: One line that names the key.
    """
    try:
        find_policy(name)
    except FileNotFoundError as error:
        raise ConfigError(f"{key}: {error}") from None


def find_start(options: RunOptions) -> Path | None:
    """Find and check the checkpoint to go on from, if there is one.

    Raises:
        ConfigError: There is none that can be read, its content cannot be used, or nothing is left to do.
    """
    if options.resume is None:
        return None
    from spin_rl.runners.checkpoint import find_checkpoint
    from spin_rl.runners.contents import check_checkpoint

    try:
        path, state = find_checkpoint(options.resume)
        check_checkpoint(state, str(path))
    except (FileNotFoundError, ValueError) as error:
        raise ConfigError(f"resume: {error}") from None
    if state["iteration"] >= options.max_iterations:
        raise ConfigError(f"max_iterations: {path} has {state['iteration']} already, those before count")
    return path


@contextlib.contextmanager
def claimed(options: RunOptions, checkpoint: Path | None) -> Iterator[Path]:
    """Hold the folder of this run, which no other process may write to meanwhile.

    A resumed run stays in its own folder unless another is named.

    Raises:
        ConfigError: It cannot be written, another run is in it, or another process has it.
    """
    from filelock import FileLock, Timeout

    path = _place(options, checkpoint)
    if not common.is_main_process():
        yield path
        return
    try:
        made = not path.exists()
        path.mkdir(parents=True, exist_ok=True)
        lock = FileLock(path / ".lock")
        lock.acquire(timeout=0)
    except Timeout:
        raise ConfigError(f"run_dir: {path} is in use by another training") from None
    except (OSError, NotImplementedError) as error:
        why = reason(error) if isinstance(error, OSError) else error
        raise ConfigError(f"run_dir: cannot write to {path}: {why}") from None
    try:
        _refuse_other_run(path, checkpoint)
        for folder in (path, path / "checkpoints"):
            remove_temporary(folder)
        yield path
    finally:
        if made and {file.name for file in path.iterdir()} == {".lock"}:  # it was refused: leave nothing
            with contextlib.suppress(OSError):
                (path / ".lock").unlink()
                path.rmdir()
        lock.release()


def _place(options: RunOptions, checkpoint: Path | None) -> Path:
    named = any(override.startswith("run_dir=") for override in options.overrides)
    if checkpoint is not None and checkpoint.parent.name == "checkpoints" and not named:
        return checkpoint.parent.parent
    return options.run_dir


def _refuse_other_run(path: Path, checkpoint: Path | None) -> None:
    from spin_rl.runners.checkpoint import holds_run

    own = checkpoint is not None and checkpoint.resolve().parent == (path / "checkpoints").resolve()
    if own or not holds_run(path):
        return
    if checkpoint is None:
        raise ConfigError(
            f"run_dir: {path} holds a run; continue it with resume={path} or name another folder"
        )
    raise ConfigError(f"run_dir: {path} holds another run than {checkpoint}; name another folder")


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
    filters = [run.get("depth", {}).get("filter", {}) for run in (trained, values)]
    then, now = ([read.get(name) for name in ("near_m", "far_m")] for read in filters)
    if then == now or None in then:
        return ""
    return f"; it read depths of {then[0]} to {then[1]} m, here they are {now[0]} to {now[1]} m"


def _changed_settings(before: Any, now: Any, path: str = "") -> list[str]:
    """List settings that differ as `key=value`."""
    if isinstance(before, dict) and isinstance(now, dict):
        keys = [key for key in now if path or key not in _NOT_TOLD]
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
    processes = read_ranks().world_size
    summary = summary | {"device": options.device, "processes": processes, "seed": options.seed}
    path = run_dir / "summary.json"
    # JSON has no NaN: rates of no episodes are null.
    plain = {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in summary.items()}
    write_json(path, plain)
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


def videos(
    options: RunOptions, task: TaskConfig, run_dir: Path
) -> contextlib.AbstractContextManager[Callable[[], None]]:
    """Make the videos that the call asks for while its run goes on; only the main process does."""
    minutes = options.video_minutes if common.is_main_process() else None
    return made_on_the_way(run_dir, minutes, task.episode_s)


def was_stopped(summary: Mapping[str, Any]) -> bool:
    """Whether a run ended because someone asked for it, and not at a limit of its own."""
    return summary["stopped_by"] not in LIMITS
