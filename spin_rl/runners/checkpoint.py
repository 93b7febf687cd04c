"""Checkpoints that a killed process cannot break: written beside, synchronized, then renamed into place."""

from __future__ import annotations

import hashlib
import os
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import nn

from spin_rl.files import sync_folder, write_atomically

FORMAT_VERSION = 1
KEEP_NUMBERED = 3
_NUMBERED = re.compile(r"iteration_(\d+)\.pt")


def save_checkpoint(path: Path, state: Mapping[str, Any]) -> None:
    """Write a checkpoint of tensors, numbers, strings and containers of them.

    Args:
        path: Destination, replaced if it exists.
        state: Content; the format version is added.

    Raises:
        TypeError: A value could not be read back by `load_checkpoint`; the message names its key.
        OSError: The file cannot be written.
    """
    _check_plain(state, "")
    content = {"version": FORMAT_VERSION, **state}
    write_atomically(path, lambda file: torch.save(content, file))


def save_numbered(folder: Path, iteration: int, state: Mapping[str, Any]) -> Path:
    """Write `last.pt` and `iteration_<n>.pt` in a folder, and delete numbered ones but the newest few.

    Returns:
        The path of `last.pt`.
    """
    last = folder / "last.pt"
    save_checkpoint(last, state)
    numbered = folder / f"iteration_{iteration:07d}.pt"
    temporary = folder / f".{numbered.name}.tmp"
    try:
        temporary.unlink(missing_ok=True)
        os.link(last, temporary)  # the same bytes: no second write
        os.replace(temporary, numbered)
        sync_folder(folder)
    except OSError:  # a file system without hard links
        save_checkpoint(numbered, state)
    for old in _numbered(folder)[KEEP_NUMBERED:]:
        old.unlink(missing_ok=True)
    return last


def load_checkpoint(path: Path) -> dict[str, Any]:
    """Read a checkpoint to the CPU without running code from it.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is damaged, or no checkpoint of this format.
    """
    if not path.is_file():
        raise FileNotFoundError(f"There is no checkpoint at {path}.")
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # the archive, the pickle and the tensors each have their own errors
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ValueError(f"The checkpoint {path} cannot be read: {reason}") from error
    if not isinstance(state, dict) or state.get("version") != FORMAT_VERSION:
        raise ValueError(f"{path} is not a checkpoint of format version {FORMAT_VERSION}.")
    return state


def find_checkpoint(run_dir_or_file: str | Path) -> tuple[Path, dict[str, Any]]:
    """Read a checkpoint file, or the newest checkpoint of a run that can be read.

    Args:
        run_dir_or_file: A checkpoint, a run's folder, or its `checkpoints` folder.

    Returns:
        The path that was read and its content.

    Raises:
        FileNotFoundError: There is no checkpoint.
        ValueError: None can be read.
    """
    path = Path(run_dir_or_file)
    if not path.is_dir():
        return path, load_checkpoint(path)
    folder = path / "checkpoints" if (path / "checkpoints").is_dir() else path
    candidates = [candidate for candidate in (folder / "last.pt", *_numbered(folder)) if candidate.exists()]
    if not candidates:
        raise FileNotFoundError(f"There is no checkpoint in {path}.")
    for candidate in candidates:
        try:
            return candidate, load_checkpoint(candidate)
        except ValueError as error:
            print(f"warning: {error}; trying an older one", file=sys.stderr, flush=True)
    raise ValueError(f"None of the {len(candidates)} checkpoints in {folder} can be read.")


def resolve_checkpoint(run_dir_or_file: str | Path) -> Path:
    """Return the path that `find_checkpoint` reads."""
    return find_checkpoint(run_dir_or_file)[0]


def load_module_state(module: nn.Module, state: Mapping[str, torch.Tensor], name: str, source: str) -> None:
    """Load parameters and buffers, all or none.

    Raises:
        ValueError: Keys or shapes differ; one line names them.
    """
    own = module.state_dict()
    differences = [f"{key} is missing" for key in own.keys() - state.keys()]
    differences += [f"{key} is not in the model" for key in state.keys() - own.keys()]
    differences += [
        f"{key} is {tuple(state[key].shape)}, the model has {tuple(own[key].shape)}"
        for key in own.keys() & state.keys()
        if own[key].shape != state[key].shape
    ]
    if differences:
        more = f" and {len(differences) - 4} more" if len(differences) > 4 else ""
        raise ValueError(f"{source} does not fit the {name}: {'; '.join(sorted(differences)[:4])}{more}.")
    module.load_state_dict(dict(state))


def weights_digest(module: nn.Module) -> str:
    """Return a hash of parameters and buffers, their names, types and shapes, as hexadecimal digits."""
    digest = hashlib.sha256()
    for key, value in sorted(module.state_dict().items()):
        digest.update(f"{key} {value.dtype} {tuple(value.shape)}".encode())
        digest.update(value.cpu().numpy().tobytes())
    return digest.hexdigest()


def to_cpu(value: Any) -> Any:
    """Copy the tensors of nested containers to the CPU."""
    if isinstance(value, torch.Tensor):
        return value.detach().cpu()
    if isinstance(value, Mapping):
        return {key: to_cpu(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [to_cpu(item) for item in value]
    return value


def _numbered(folder: Path) -> list[Path]:
    """Numbered checkpoints, newest first."""
    found = [(int(match[1]), path) for path in folder.iterdir() if (match := _NUMBERED.fullmatch(path.name))]
    return [path for _, path in sorted(found, reverse=True)]


def _check_plain(value: Any, where: str) -> None:
    if isinstance(value, Mapping):
        for key, item in value.items():
            _check_plain(item, f"{where}.{key}" if where else str(key))
    elif isinstance(value, list | tuple):
        for index, item in enumerate(value):
            _check_plain(item, f"{where}[{index}]")
    elif type(value) not in (torch.Tensor, nn.Parameter, int, float, bool, str, type(None)):
        raise TypeError(
            f"A checkpoint cannot hold {where}: {type(value).__name__} is not a tensor, number or string."
        )
