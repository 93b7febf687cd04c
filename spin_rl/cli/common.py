"""What every command shares: composing the configuration, one-line errors, devices, announced compilation."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType, MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from spin_rl.cli import help_text, refusals
from spin_rl.config import ConfigError, Means, check_value
from spin_rl.files import check_writable, reason
from spin_rl.machine import num_gpus
from spin_rl.paths import CONF_DIR
from spin_rl.ranks import read_ranks
from spin_rl.tasks.common.compose import compose, plain

if TYPE_CHECKING:
    from spin_rl.benchmark.policies import PolicySource
    from spin_rl.scenes.layout import Scene

PolicyName = Annotated[str, Means("a name, checkpoint, run directory, .safetensors file, zero or random")]
GROUPS = frozenset({"robot", "scene", "reward", "sim", "depth", "task", "algo", "runner"})
"""Keys at the top of a configuration that hold mappings."""
TASK_GROUPS = GROUPS - {"algo", "runner"}
"""Those that say what a task is like."""
HYDRA_FLAGS = frozenset(
    f"--{name}"
    for name in (
        *("help", "hydra-help", "version", "cfg", "resolve", "package", "run", "multirun", "info"),
        *("shell-completion", "config-path", "config-name", "config-dir", "experimental-rerun"),
    )
)
"""What Hydra itself takes; what else has dashes would get its usage in eight lines."""
INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells have it."""
RENAMED = {"baseline": "camera"} | {
    f"camera.{key}": f"camera_analysis.{key}" for key in ("tilts", "blind", "cells")
}
"""Old name of a setting -> what it is called now."""
# What a user can cause; anything else is a defect and keeps its traceback.
USER_ERRORS = (
    ConfigError,
    ValueError,
    OSError,
    FloatingPointError,
    HydraException,
    OmegaConfBaseException,
)


@dataclass(frozen=True)
class Call:
    """A call of a command.

    Attributes:
        values: Its composed configuration, nested.
        overrides: Those of the command line, and those that follow from them, such as the policy's task.
        opened: The policy that the command line names, where it was opened to know its task.
    """

    values: dict[str, Any]
    overrides: Sequence[str]
    opened: PolicySource | None = None


Completed = tuple[list[str], "PolicySource | None"]
"""Overrides with those that follow from them, and the policy that was opened to know which do."""


Body = Callable[[Call], bool | None]
"""A command; returns True where it was asked to stop, which also ends a sweep."""


def run(
    name: str,
    body: Body,
    complete: Callable[[list[str]], Completed],
    keys: frozenset[str],
    refused: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Run a command: compose its configuration of the command line's overrides and call `body`.

    Exits with status 2 and one line on standard error when the configuration or input is bad, and with 130
    and one line after Ctrl-C or SIGTERM, unless the command has its own way to end; with Hydra's
    HYDRA_FULL_ERROR=1 in the environment, with the traceback. Hydra itself runs the command only where it is
    given its own flags or settings, such as `-m`, `--cfg=job` or `hydra.sweep.dir`.

    Args:
        name: Configuration file in conf/, also the command's name after `spin-`.
        body: The command.
        complete: Appends the overrides that follow from those given.
        keys: What its configuration has at the top; see `keys_of`.
        refused: Arguments that this command cannot take, and why.
    """
    arguments = sys.argv[1:]
    sys.path.append(os.getcwd())  # for rewards of one's own; last, so that nothing here hides a package
    if help_text.is_asked_for(arguments):
        print(help_text.of(name))
        return
    with _orderly_end(name):
        for argument in arguments:
            _refuse(argument, refused)
        overrides, opened = complete(arguments)
        if not any(_is_of_hydra(argument) for argument in arguments):
            values = compose(name, overrides)
            check_keys(name, values, keys)
            body(Call(values, overrides, opened))
            return

        def job(cfg: DictConfig) -> None:
            with _orderly_end(name):
                values = plain(cfg)
                check_keys(name, values, keys)
                if body(Call(values, HydraConfig.get().overrides.task, opened)):
                    sys.exit(INTERRUPTED)

        # Hydra reads these, and wants overrides side by side, before flags that may take the next word.
        flags = [argument for argument in overrides if not _is_override(argument)]
        sys.argv[1:] = [*filter(_is_override, overrides), *flags]
        hydra.main(version_base="1.3", config_path=str(CONF_DIR), config_name=name)(job)()


def _refuse(argument: str, refused: Mapping[str, str]) -> None:
    """Reject an argument that a command cannot take, and one of a setting that has another name now."""
    if argument in refused:
        raise ConfigError(refused[argument])
    key, sign, value = argument.lstrip("+~").partition("=")
    if sign and not key:
        raise ConfigError(f"{argument}: expected key=value")
    if key.startswith("--") and key not in HYDRA_FLAGS:
        raise ConfigError(f"{argument}: unknown flag; settings are key=value, without dashes")
    if value in ("null", "") and key in {path.name for path in CONF_DIR.iterdir() if path.is_dir()}:
        raise ConfigError(f"{key}: expected the name of a file in conf/{key}, got {value or 'nothing'}")
    if key in RENAMED:
        raise ConfigError(f"{key}: is called {RENAMED[key]} now: {RENAMED[key]}={value}")


def _is_of_hydra(argument: str) -> bool:
    return argument.startswith("-") or argument.lstrip("+~").startswith(("hydra.", "hydra/"))


def _is_override(argument: str) -> bool:
    return argument[:1] != "-" and ("=" in argument or argument[:1] == "~")


def keys_of(options: type, groups: Collection[str]) -> frozenset[str]:
    """What the configuration of a command has at the top: the fields of its options, and groups."""
    return frozenset({*(field.name for field in dataclasses.fields(options)), *groups})


def check_keys(name: str, values: Mapping[str, Any], keys: frozenset[str]) -> None:
    """Reject what nothing reads, what is missing, and what is in the place of a group.

    Raises:
        ConfigError: One line that names the key.
    """
    for key in values:
        if key not in keys:
            raise ConfigError(refusals.unknown_key(key, name))
    for key in GROUPS:
        if key in keys:
            check_value(dict[str, Any], values.get(key), key)
    for key in keys - GROUPS - {"overrides"}:
        if key not in values:
            raise ConfigError(f"{key}: a value is needed")


@contextlib.contextmanager
def _orderly_end(name: str) -> Iterator[None]:
    """Turn what a user can cause into one line and an exit status."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    is_main_thread = threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGTERM, stop) if is_main_thread else None
    try:
        yield
    except KeyboardInterrupt:
        print(f"\nspin-{name}: interrupted", file=sys.stderr)
        sys.exit(INTERRUPTED)
    except USER_ERRORS as error:
        if os.environ.get("HYDRA_FULL_ERROR") == "1":
            raise
        print(f"spin-{name}: error: {refusals.reason(error, name, sys.argv[1:])}", file=sys.stderr)
        sys.exit(2)
    finally:
        if is_main_thread:
            signal.signal(signal.SIGTERM, before)


def resolve_device(device: str) -> str:
    """Turn `auto` into this process's device; check that a named one exists.

    Under torchrun, `auto` and `cuda` are the GPU of the local rank.

    Raises:
        ConfigError: The device does not exist here.
    """
    rank = read_ranks().local_rank
    if device == "auto":
        device = "cuda" if num_gpus() else "cpu"
    if device == "cpu":
        return device
    if device == "cuda":
        device = f"cuda:{rank}"
    match = re.fullmatch(r"cuda:(\d+)", str(device))
    if match is None:
        raise ConfigError(f"device: unknown device {device!r}; use auto, cpu or cuda:0")
    index, gpus = int(match[1]), num_gpus()
    if index >= gpus:
        raise ConfigError(f"device: {device} is not available here; {gpus} GPUs found")
    return f"cuda:{index}"


def with_preset(arguments: list[str], group: str = "preset") -> list[str]:
    """Add `preset=gpu`, or another group's, where the command will run on a GPU and no preset is named."""
    given = {key: value for key, _, value in (argument.partition("=") for argument in arguments)}
    if group in given or given.get("device", "auto") == "cpu" or not num_gpus():
        return arguments
    return [*arguments, f"{group}=gpu"]


def scene_file_argument(argument: str) -> str:
    """Turn `scene=<file>` into `scene_file=<file>`: `scene` is also a group, so Hydra would refuse a file.

    Raises:
        ConfigError: It names several files.
    """
    key, _, value = argument.partition("=")
    if key in ("scene", "scene_file") and value.startswith("["):
        raise ConfigError(f"{key}: takes one file at a time, got {value}; benchmark=scenes takes all shipped")
    names_file = value.endswith((".yaml", ".yml")) or ("/" in value and Path(value).is_file())
    return f"scene_file={value}" if key == "scene" and names_file else argument


def make_folder_of(out: Path | None, example: str) -> None:
    """Make the folder that the file named by `out` goes to; nothing to do for None.

    Args:
        out: The option's value.
        example: File name for the message about a folder.

    Raises:
        ConfigError: It is a folder or something else that is no file, or cannot be written.
    """
    if out is None:
        return
    try:
        if out.is_dir():
            raise ConfigError(f"out: {out} is a folder; name a file such as {out / example}")
        check_writable(out)
    except OSError as error:
        raise ConfigError(f"out: cannot write {reason(error)}") from None


def load_scene_file(name: Path | None) -> Scene | None:
    """Read a user-written scene, or one of conf/scenes_examples by its file's name; None for None.

    Raises:
        ConfigError: There is no such file, or it is no scene.
    """
    if name is None:
        return None
    from spin_rl.scenes.scene_file import find_scene, load_scene

    return load_scene(find_scene(name))


def is_main_process() -> bool:
    """Whether this process is the one that prints and writes, under torchrun or alone."""
    return read_ranks().is_main


@contextlib.contextmanager
def announced(what: str) -> Iterator[None]:
    """Announce work that may compile kernels, and show that it goes on while it does."""
    if not is_main_process():
        yield
        return
    start = time.monotonic()
    finished = threading.Event()
    print(f"{what} (kernels are compiled once per machine: 1-2 minutes the first time)", flush=True)

    def report() -> None:
        while not finished.wait(10.0):
            print(f"  still starting, {time.monotonic() - start:.0f} s", flush=True)

    thread = threading.Thread(target=report, daemon=True)
    thread.start()
    try:
        yield
    finally:
        finished.set()
        thread.join()
    print(f"  ready after {time.monotonic() - start:.0f} s", flush=True)
