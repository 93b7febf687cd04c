"""What is said of a configuration that cannot be composed: one line that names the key and what was meant."""

from __future__ import annotations

import contextlib
import difflib
import re
from collections.abc import Iterator, Sequence
from typing import Any

from hydra.errors import HydraException, OverrideParseException
from omegaconf.errors import OmegaConfBaseException

from spin_rl import files
from spin_rl.config import ConfigError
from spin_rl.paths import CONF_DIR
from spin_rl.tasks.common.compose import compose

_UNKNOWN_KEY = re.compile(r"Could not override '([^']+)'")
_AMBIGUOUS = re.compile(r"Ambiguous value for argument '(?P<key>[^'=]+)=")
_UNKNOWN_CHOICE = re.compile(r"Could not find '(?P<group>[^']+)/(?P<choice>[^'/]+)'")
_MOST_LISTED = 12


def reason(error: Exception, name: str, arguments: Sequence[str]) -> str:
    """Say in one line why a command refuses.

    Hydra's advice to add an unknown key with + is left out: what nothing reads would then be accepted.

    Args:
        error: What was raised.
        name: The command's configuration file.
        arguments: The command line.
    """
    if isinstance(error, OSError) and not isinstance(error, HydraException):  # one of these is both
        return files.reason(error)
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    text = " ".join(line for line in lines if "HYDRA_FULL_ERROR" not in line) or type(error).__name__
    if isinstance(error, OverrideParseException):  # its message shows a part only
        return f"{error.override}: {text}"
    if isinstance(error, HydraException):
        choice, key, several = (
            pattern.search(text) for pattern in (_UNKNOWN_CHOICE, _UNKNOWN_KEY, _AMBIGUOUS)
        )
        if several is not None:
            return f"{several['key']}: takes one value at a time; -m runs several, one after the other"
        if choice is not None:
            options = ", ".join(_choices(choice["group"]))
            return f"{choice['group']}: unknown {choice['choice']!r}; choose from {options}"
        if key is not None:
            return unknown_key(key[1].partition("@")[0], name, arguments)
    return text


@contextlib.contextmanager
def in_one_line(name: str, arguments: Sequence[str]) -> Iterator[None]:
    """Say in one line what Hydra refuses, for those who call from Python; see `reason`.

    Raises:
        ConfigError: In place of what Hydra raises.
    """
    try:
        yield
    except (HydraException, OmegaConfBaseException) as error:
        raise ConfigError(reason(error, name, arguments)) from None


def unknown_key(key: str, name: str, arguments: Sequence[str] = ()) -> str:
    """Say that there is no such key, and which may have been meant."""
    tasks = [argument for argument in arguments if argument.startswith("task=")]
    values: Any = compose(name, tasks)
    *above, last = key.split(".")
    for part in above:
        values = values.get(part) if isinstance(values, dict) else None
    names = set(map(str, values)) if isinstance(values, dict) else set()
    if not above:
        names |= {folder.name for folder in CONF_DIR.iterdir() if folder.is_dir()}
    known = sorted(names)
    where = "".join(f"{part}." for part in above)
    close = difflib.get_close_matches(last, known, n=2, cutoff=0.7)
    if not above and key in names:  # a group whose files change others, such as `camera`
        return f"{key}: has no settings of its own; choose {key}={' or '.join(_choices(key))}"
    if close:
        return f"{key}: unknown key; did you mean {' or '.join(where + match for match in close)}?"
    if 0 < len(known) <= _MOST_LISTED:
        return f"{key}: unknown key; choose from {', '.join(where + option for option in known)}"
    return f"{key}: unknown key; see spin-{name} --help"


def _choices(group: str) -> list[str]:
    return sorted(file.stem for file in (CONF_DIR / group).glob("*.yaml"))
