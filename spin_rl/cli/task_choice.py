"""Which task a command is about, found before its configuration is composed: tasks have different keys."""

from __future__ import annotations

from typing import Any

from spin_rl.benchmark.policies import open_policy
from spin_rl.benchmark.registry import BENCHMARKS
from spin_rl.config import ConfigError
from spin_rl.tasks.registry import TASKS

_DEFAULT = "nav"
UNTRAINABLE = {
    f"task={name}": f"task: {spec.untrainable}" for name, spec in TASKS.items() if spec.untrainable
}
"""Arguments that make no training, and why."""


def with_task(arguments: list[str], key: str = "policy") -> list[str]:
    """Add `task=<name>` where the named benchmark, or else the named policy, is of another task than nav.

    Args:
        arguments: Of the command line.
        key: What names the policy.
    """
    given = dict(argument.partition("=")[::2] for argument in arguments)
    if "task" in given:
        return arguments
    benchmark = BENCHMARKS.get(given.get("benchmark", ""))
    task = _task_of_policy(given.get(key, "")) if benchmark is None else benchmark.task
    return arguments if task == _DEFAULT else [*arguments, f"task={task}"]


def _task_of_policy(name: str) -> str:
    try:
        return trained_task(open_policy(name)[1]) or _DEFAULT
    except ConfigError:
        return _DEFAULT  # the command itself says what is wrong with it


def trained_task(trained: dict[str, Any]) -> str | None:
    """Name of the task that a policy was trained in, by its configuration; None for one that has none."""
    return (trained or {}).get("task", {}).get("name")


def check_task(policy: str, trained: dict[str, Any], task: str, key: str = "policy") -> None:
    """Reject a policy of another task.

    Args:
        policy: Its name.
        trained: Configuration of its training.
        task: The task of the command.
        key: What names the policy.

    Raises:
        ConfigError: The policy was trained in another task.
    """
    own = trained_task(trained)
    if own is not None and own != task:
        raise ConfigError(f"{key}: {policy} was trained with task={own}, which is not task={task}")
