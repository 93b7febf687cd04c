"""The tasks by name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from omegaconf import DictConfig

from spin_rl.config import ConfigError
from spin_rl.tasks.common.compose import plain
from spin_rl.tasks.common.config import TaskConfig
from spin_rl.tasks.common.env import TaskEnv
from spin_rl.tasks.common.spec import TaskSpec
from spin_rl.tasks.fetch.spec import FETCH
from spin_rl.tasks.nav.spec import NAV
from spin_rl.tasks.pick.spec import PICK

__all__ = ["TASKS", "TaskSpec", "any_config", "find_task", "make_env", "plain"]

TASKS: Mapping[str, TaskSpec] = MappingProxyType({task.name: task for task in (NAV, PICK, FETCH)})


def find_task(name: str) -> TaskSpec:
    """Return the task of a name.

    Raises:
        ConfigError: There is none; one line that lists those there are.
    """
    if name not in TASKS:
        raise ConfigError(f"task: unknown {name!r}; choose from {', '.join(TASKS)}")
    return TASKS[name]


def any_config(cfg: DictConfig | Mapping[str, Any]) -> TaskConfig:
    """Build the configuration of the task that `task.name` names; see `TaskSpec.configure`."""
    return find_task(cfg["task"]["name"]).configure(cfg)


def make_env(cfg: TaskConfig, num_envs: int, device: str, seed: int) -> TaskEnv:
    """Start a task in a number of worlds on a device."""
    spec = next(task for task in TASKS.values() if task.config is type(cfg))
    return spec.make_env(cfg, num_envs, device, seed)
