"""The tasks by name."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import entry_points
from types import MappingProxyType

from spin_rl.config import ConfigError, short
from spin_rl.tasks.common.spec import TaskSpec
from spin_rl.tasks.fetch.spec import FETCH
from spin_rl.tasks.nav.spec import NAV
from spin_rl.tasks.pick.spec import PICK

__all__ = ["TASKS", "TaskSpec", "find_task"]

TASKS: Mapping[str, TaskSpec] = MappingProxyType({task.name: task for task in (NAV, PICK, FETCH)})

GROUP = "spin_rl.tasks"
"""Entry points by which a package adds a task: name = "package.module:SPEC"."""


def find_task(name: str | None) -> TaskSpec:
    """Return the task of a name, one of ours or of another installed package; see `GROUP`.

    Raises:
        ConfigError: There is none; one line that lists those there are.
    """
    if isinstance(name, str) and name in TASKS:
        return TASKS[name]
    for point in entry_points(group=GROUP, name=str(name)):
        spec = point.load()
        if isinstance(spec, TaskSpec) and spec.name == name:
            return spec
        raise ConfigError(f"task: {point.value} is no TaskSpec with the name {short(name)}")
    raise ConfigError(f"task: unknown {short(name)}; choose from {', '.join(TASKS)}")
