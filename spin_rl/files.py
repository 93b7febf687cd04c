"""Files that a killed process cannot leave half-written."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import secrets
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

_LONGEST_STEM = 100


def write_atomically(path: Path, write: Callable[[BinaryIO], Any]) -> None:
    """Replace a file in one step: readers see the old or the new content, whenever the process is killed.

    Of a symbolic link, the file that it leads to is replaced.

    Args:
        path: File to replace; its folder is created.
        write: Called with the open temporary file, which lies in the same folder.

    Raises:
        OSError: The file cannot be written, or is something else than a regular file; the old one is still
            there, and nothing is left beside it.
    """
    with named_errors(path):
        target = _regular(path)
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = temporary_beside(target)
        try:
            with open(temporary, "xb") as file:
                write(file)
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, target)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
        sync_folder(target.parent)


def temporary_beside(path: Path) -> Path:
    """Name a file beside another one that no other process or call names; see `remove_temporary`."""
    return path.with_name(f".{path.name[:_LONGEST_STEM]}.{os.getpid()}.{secrets.token_hex(4)}.tmp")


def remove_temporary(folder: Path) -> None:
    """Remove what killed processes have left in a folder that nobody else writes to now."""
    for left in folder.glob(".*.tmp"):
        left.unlink(missing_ok=True)


def check_writable(path: Path) -> None:
    """Find out whether a file can be written, without changing it; its folder is created.

    Raises:
        OSError: It cannot be, or is something else than a regular file.
    """
    with named_errors(path):
        target = _regular(path)
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = temporary_beside(target)
        with open(temporary, "xb"):
            temporary.unlink()


@contextlib.contextmanager
def named_errors(path: Path) -> Iterator[None]:
    """Let errors of the system name a path, which those of writing do not."""
    try:
        yield
    except OSError as error:
        error.filename, error.filename2 = str(path), None
        raise


def reason(error: OSError) -> str:
    """One line about an error of the system: the file and what is wrong with it."""
    what = error.strerror or str(error) or type(error).__name__
    return what if error.filename is None else f"{error.filename}: {what}"


def _regular(path: Path) -> Path:
    """Follow symbolic links to a regular file, or to where there is none yet."""
    target = path.resolve() if path.is_symlink() else path
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if os.path.lexists(target) and not target.is_file():
        raise OSError(errno.EINVAL, "is not a regular file", str(path))
    return target


def write_text(path: Path, text: str) -> None:
    """Replace a text file in one step, see `write_atomically`."""
    write_atomically(path, lambda file: file.write(text.encode()))


def write_json(path: Path, value: Any) -> None:
    """Replace a JSON file in one step, see `write_atomically`; NaN and infinity are refused.

    Raises:
        ValueError: A number is not finite.
    """
    write_text(path, json.dumps(value, indent=2, allow_nan=False) + "\n")


def sync_folder(folder: Path) -> None:
    """Make a rename durable."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
