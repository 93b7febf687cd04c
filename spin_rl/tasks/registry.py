"""The tasks by name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from spin_rl.config import ConfigError, short
from spin_rl.tasks.common.spec import TaskSpec
from spin_rl.tasks.fetch.spec import FETCH
from spin_rl.tasks.nav.spec import NAV
from spin_rl.tasks.pick.spec import PICK

__all__ = ["TASKS", "TaskSpec", "find_task"]

TASKS: Mapping[str, TaskSpec] = MappingProxyType({task.name: task for task in (NAV, PICK, FETCH)})


def find_task(name: str | None) -> TaskSpec:
    """Return the task of a name.

    Raises:
        ConfigError: There is none; one line that lists those there are.
    """
    if not isinstance(name, str) or name not in TASKS:
        raise ConfigError(f"task: unknown {short(name)}; choose from {', '.join(TASKS)}")
    return TASKS[name]
