"""What every command shares: composing the configuration, one-line errors, devices, announced compilation."""

from __future__ import annotations

import contextlib
import os
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import hydra
import torch
import warp as wp
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException, OverrideParseException
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from spin_rl.benchmark.policies import PolicySource
from spin_rl.config import ConfigError, Means
from spin_rl.paths import CONF_DIR
from spin_rl.scenes.layout import Scene
from spin_rl.scenes.scene_file import find_scene, load_scene
from spin_rl.tasks.common.compose import compose, plain

PolicyName = Annotated[str, Means("a name, checkpoint, run directory, .safetensors file, zero or random")]
RENAMED = {"baseline": "camera"} | {
    f"camera.{key}": f"camera_analysis.{key}" for key in ("tilts", "blind", "cells")
}
"""Old name of a setting -> what it is called now."""
# What a user can cause; anything else is a defect and keeps its traceback.
USER_ERRORS = (
    ConfigError,
    ValueError,
    FileNotFoundError,
    FileExistsError,
    NotADirectoryError,
    PermissionError,
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


Completed = tuple[list[str], PolicySource | None]
"""Overrides with those that follow from them, and the policy that was opened to know which do."""


def run(
    name: str,
    body: Callable[[Call], None],
    complete: Callable[[list[str]], Completed],
    refused: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Run a command: compose its configuration of the command line's overrides and call `body`.

    Exits with status 2 and one line on standard error when the configuration or input is bad; with Hydra's
    HYDRA_FULL_ERROR=1 in the environment, with the traceback. Hydra itself runs the command only where it is
    given its own flags or settings, such as `--help`, `-m` or `hydra.sweep.dir`.

    Args:
        name: Configuration file in conf/, also the command's name after `spin-`.
        body: The command.
        complete: Appends the overrides that follow from those given.
        refused: Arguments that this command cannot take, and why.
    """
    arguments = sys.argv[1:]
    with _one_line_errors(name):
        for argument in arguments:
            _refuse(argument, refused)
        overrides, opened = complete(arguments)
        if not any(_is_of_hydra(argument) for argument in arguments):
            body(Call(compose(name, overrides), overrides, opened))
            return

        def job(cfg: DictConfig) -> None:
            with _one_line_errors(name):
                body(Call(plain(cfg), HydraConfig.get().overrides.task, opened))

        # Hydra reads these, and wants overrides side by side: behind a flag, further ones are unknown to it.
        given = [i for i, argument in enumerate(arguments) if "=" in argument and argument[0] != "-"]
        end = max(given, default=-1) + 1
        sys.argv[1:] = [*overrides[:end], *overrides[len(arguments) :], *overrides[end : len(arguments)]]
        hydra.main(version_base="1.3", config_path=str(CONF_DIR), config_name=name)(job)()


def _refuse(argument: str, refused: Mapping[str, str]) -> None:
    """Reject an argument that a command cannot take, and one of a setting that has another name now."""
    if argument in refused:
        raise ConfigError(refused[argument])
    key, _, value = argument.lstrip("+~").partition("=")
    if key in RENAMED:
        raise ConfigError(f"{key}: is called {RENAMED[key]} now: {RENAMED[key]}={value}")


def _is_of_hydra(argument: str) -> bool:
    return argument.startswith("-") or argument.lstrip("+~").startswith(("hydra.", "hydra/"))


@contextlib.contextmanager
def _one_line_errors(name: str) -> Iterator[None]:
    try:
        yield
    except USER_ERRORS as error:
        if os.environ.get("HYDRA_FULL_ERROR") == "1":
            raise
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        # Hydra's advice on its own internals helps no one here.
        reason = " ".join(line for line in lines if "HYDRA_FULL_ERROR" not in line) or type(error).__name__
        if isinstance(error, OverrideParseException):  # its message shows a part only
            reason = f"{error.override}: {reason}"
        print(f"spin-{name}: error: {reason}", file=sys.stderr)
        sys.exit(2)


def resolve_device(device: str) -> str:
    """Turn `auto` into this process's device; check that a named one exists.

    Under torchrun, `auto` and `cuda` are the GPU of the local rank.

    Raises:
        ConfigError: The device does not exist here.
    """
    rank = int(os.environ.get("LOCAL_RANK", "0"))
    if device == "auto":
        device = "cuda" if torch.cuda.is_available() else "cpu"
    if device == "cpu":
        return device
    if device == "cuda":
        device = f"cuda:{rank}"
    match = re.fullmatch(r"cuda:(\d+)", str(device))
    if match is None:
        raise ConfigError(f"device: unknown device {device!r}; use auto, cpu or cuda:0")
    index = int(match[1])
    if not torch.cuda.is_available() or index >= torch.cuda.device_count():
        raise ConfigError(f"device: {device} is not available here; {torch.cuda.device_count()} GPUs found")
    return f"cuda:{index}"


def with_preset(arguments: list[str], has_gpu: bool, group: str = "preset") -> list[str]:
    """Add `preset=gpu`, or another group's, where the command will run on a GPU and no preset is named."""
    given = {key: value for key, _, value in (argument.partition("=") for argument in arguments)}
    on_gpu = given.get("device", "auto") != "cpu" and has_gpu
    return [*arguments, f"{group}=gpu"] if on_gpu and group not in given else arguments


def scene_file_argument(argument: str) -> str:
    """Turn `scene=<file>` into `scene_file=<file>`: `scene` is also a group, so Hydra would refuse a file."""
    key, _, value = argument.partition("=")
    names_file = value.endswith((".yaml", ".yml")) or ("/" in value and Path(value).is_file())
    return f"scene_file={value}" if key == "scene" and names_file else argument


def make_folder_of(out: Path | None, example: str) -> None:
    """Make the folder that the file named by `out` goes to; nothing to do for None.

    Args:
        out: The option's value.
        example: File name for the message about a folder.

    Raises:
        ConfigError: It is a folder, or its folder cannot be made.
    """
    if out is None:
        return
    if out.is_dir():
        raise ConfigError(f"out: {out} is a folder; name a file such as {out / example}")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"out: cannot make the folder {out.parent}: {error.strerror}") from None


def load_scene_file(name: Path | None) -> Scene | None:
    """Read a user-written scene, or one of conf/scenes_examples by its file's name; None for None.

    Raises:
        ConfigError: There is no such file, or it is no scene.
    """
    return None if name is None else load_scene(find_scene(name))


def is_main_process() -> bool:
    """Whether this process is the one that prints and writes, under torchrun or alone."""
    return os.environ.get("RANK", "0") == "0"


@contextlib.contextmanager
def announced(what: str) -> Iterator[None]:
    """Announce work that may compile kernels, and show that it goes on while it does."""
    wp.config.log_level = max(wp.config.log_level, wp.LOG_WARNING)
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
