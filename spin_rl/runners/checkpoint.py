"""Checkpoints that a killed process cannot break: written beside, synchronized, then renamed into place.

A checkpoint is a file of `torch.save` with its SHA-256 behind it. Those of format 1 had none; they have the
sums that every ZIP archive has of its members.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
import sys
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import nn

from spin_rl.files import sync_folder, temporary_beside, write_atomically

FORMAT_VERSION = 2
_WITHOUT_CHECKSUM = 1
KEEP_NUMBERED = 3
SET_ASIDE = "set_aside"
"""Folder beside the checkpoints for those of a branch that was given up."""
_MARK = b"SHA-256:"
_DIGEST_SIZE = hashlib.sha256().digest_size
_TAIL = len(_MARK) + _DIGEST_SIZE
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
    buffer = io.BytesIO()
    torch.save({**state, "version": FORMAT_VERSION}, buffer)
    content = buffer.getvalue()
    checksum = _MARK + hashlib.sha256(content).digest()
    write_atomically(path, lambda file: file.write(content + checksum))


def save_numbered(folder: Path, iteration: int, state: Mapping[str, Any]) -> Path:
    """Write `last.pt` and `iteration_<n>.pt` in a folder; delete numbered ones but this and the newest few.

    Returns:
        The path of `last.pt`.

    Raises:
        OSError: They cannot be written; what was there is still there.
    """
    last = folder / "last.pt"
    save_checkpoint(last, state)
    numbered = folder / f"iteration_{iteration:07d}.pt"
    temporary = temporary_beside(numbered)
    try:
        os.link(last, temporary)  # the same bytes: no second write
        os.replace(temporary, numbered)
        sync_folder(folder)
    except OSError:  # a file system without hard links
        temporary.unlink(missing_ok=True)
        save_checkpoint(numbered, state)
    others = [old for old in _numbered(folder) if old != numbered]
    for old in others[KEEP_NUMBERED - 1 :]:
        old.unlink(missing_ok=True)
    return last


def set_aside(path: Path) -> list[Path]:
    """Move what a run wrote after a checkpoint out of the way of the branch that now begins there.

    Args:
        path: The checkpoint, in the run's folder.

    Returns:
        Where the others are now, in a folder beside them.
    """
    folder = path.parent
    match = _NUMBERED.fullmatch(path.name)
    if match is None:
        return []  # the last one: nothing is newer
    newer = [other for other in _numbered(folder) if _number(other) > int(match[1])]
    last = folder / "last.pt"
    if last.exists() and not last.samefile(path):
        newer.append(last)
    moved = []
    for other in newer:
        target = folder / SET_ASIDE / other.name
        count = 1
        while target.exists():
            count += 1
            target = target.with_name(f"{other.stem}-{count}.pt")
        target.parent.mkdir(exist_ok=True)
        os.replace(other, target)
        moved.append(target)
    if moved:
        sync_folder(folder)
    return moved


def load_checkpoint(path: Path) -> dict[str, Any]:
    """Read a checkpoint to the CPU without running code from it.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is damaged, or no checkpoint of this format.
    """
    if not path.is_file():
        raise FileNotFoundError(f"There is no checkpoint at {path}.")
    content = path.read_bytes()
    archive, mark, checksum = content[:-_TAIL], content[-_TAIL:-_DIGEST_SIZE], content[-_DIGEST_SIZE:]
    if mark != _MARK:
        archive = content
    elif hashlib.sha256(archive).digest() != checksum:
        raise ValueError(f"The checkpoint {path} is damaged: its content does not have its checksum.")
    try:
        if mark != _MARK:
            _check_members(archive)
        state = torch.load(io.BytesIO(archive), map_location="cpu", weights_only=True)
    except Exception as error:  # the archive, the pickle and the tensors each have their own errors
        lines = str(error).splitlines()
        reason = lines[0] if lines else type(error).__name__
        raise ValueError(f"The checkpoint {path} cannot be read: {reason}") from error
    version = state.get("version") if isinstance(state, dict) else None
    if version not in (FORMAT_VERSION, _WITHOUT_CHECKSUM):
        raise ValueError(f"{path} is not a checkpoint of format version {FORMAT_VERSION}.")
    if version == FORMAT_VERSION and mark != _MARK:
        raise ValueError(f"The checkpoint {path} is damaged: it has no checksum.")
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
    differences += [
        f"{key} is {state[key].dtype}, the model has {own[key].dtype}"
        for key in own.keys() & state.keys()
        if own[key].dtype != state[key].dtype
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


def holds_run(run_dir: Path) -> bool:
    """Whether there is a checkpoint in a run's folder."""
    folder = run_dir / "checkpoints"
    return folder.is_dir() and ((folder / "last.pt").exists() or bool(_numbered(folder)))


def _check_members(archive: bytes) -> None:
    """Check the sums of a ZIP archive's members, which Torch does not."""
    with zipfile.ZipFile(io.BytesIO(archive)) as members:
        if any(member.compress_type != zipfile.ZIP_STORED for member in members.infolist()):
            raise ValueError("it is compressed")
        damaged = members.testzip()
    if damaged is not None:
        raise ValueError(f"{damaged} is damaged")


def _numbered(folder: Path) -> list[Path]:
    """Numbered checkpoints, newest first."""
    return sorted(filter(_is_numbered, folder.iterdir()), key=_number, reverse=True)


def _is_numbered(path: Path) -> bool:
    return _NUMBERED.fullmatch(path.name) is not None


def _number(path: Path) -> int:
    return int(path.stem.removeprefix("iteration_"))


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
