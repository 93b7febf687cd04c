"""A resumed run keeps its settings: the overrides that made it come before those of the present call."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from spin_rl.config import ConfigError
from spin_rl.ranks import read_ranks

PER_CALL = ("resume", "init", "run_dir", "max_minutes", "max_iterations", "evaluate")
"""Settings of a call, which a resumed run does not take over."""
_OURS = ("spin_rl", "rsl_rl")


def to_keep(overrides: Sequence[str]) -> list[str]:
    """Return the overrides of a call that a later one which resumes its run takes over."""
    return [override for override in overrides if _key(override) not in PER_CALL and override[0] != "-"]


def with_settings_of_run(arguments: Sequence[str]) -> list[str] | None:
    """Put the overrides of the run to resume before those of the command line; None where nothing is resumed.

    An override of the run gives way to one of the same key, and to a choice of the group that it is part of.

    Raises:
        ConfigError: There is no checkpoint, or code from outside is named in it and not on the command line.
    """
    sources = [argument.partition("=")[2] for argument in arguments if argument.startswith("resume=")]
    if not sources or sources[-1] in ("", "null"):
        return None
    kept = _settings_of(Path(sources[-1]))
    if kept is None:
        if read_ranks().is_main:
            print("resume: the checkpoint is older than this rule: repeat the settings of its run")
        return None
    given = {_key(argument) for argument in arguments}
    kept = [override for override in kept if not _is_replaced(_key(override), given)]
    for override in kept:
        if _names_outside_code(override):
            raise ConfigError(f"resume: the run has {override}, code from outside; to use it, give it again")
    return [*kept, *arguments]


def _settings_of(run_dir_or_file: Path) -> list[str] | None:
    if not run_dir_or_file.exists():  # before Torch is imported
        raise ConfigError(f"resume: There is no checkpoint at {run_dir_or_file}.")
    from spin_rl.runners.checkpoint import find_checkpoint

    try:
        run = json.loads(find_checkpoint(run_dir_or_file)[1]["config"])["run"]
        kept = (run or {}).get("overrides")
    except (FileNotFoundError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ConfigError(f"resume: {error}") from None
    return kept if isinstance(kept, list) and all(isinstance(override, str) for override in kept) else None


def _key(override: str) -> str:
    return override.lstrip("+~").partition("=")[0]


def _is_replaced(key: str, given: set[str]) -> bool:
    parts = key.split(".")
    return any(".".join(parts[:end]) in given for end in range(1, len(parts) + 1))


def _names_outside_code(override: str) -> bool:
    """Whether an override has a function or class imported that is not of this project or of rsl_rl."""
    key, _, value = override.lstrip("+~").partition("=")
    if key.startswith("reward.") and key.count(".") > 1:
        return key.split(".")[1] not in _OURS
    return key.endswith("class_name") and value.partition(":")[0].split(".")[0] not in _OURS
