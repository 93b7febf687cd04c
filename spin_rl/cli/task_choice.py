"""Which task a command is about, found before its configuration is composed: tasks have different keys."""

from __future__ import annotations

from spin_rl.benchmark.policies import UNSAVED, PolicySource, open_policy
from spin_rl.benchmark.registry import BENCHMARKS, find
from spin_rl.cli.common import Completed
from spin_rl.config import ConfigError
from spin_rl.policy import find_policy, task_in_header
from spin_rl.tasks.registry import TASKS

_DEFAULT = "nav"
UNTRAINABLE = {
    f"task={name}": f"task: {spec.untrainable}" for name, spec in TASKS.items() if spec.untrainable
}
"""Arguments that make no training, and why."""


def with_task(arguments: list[str], key: str = "policy") -> Completed:
    """Add `task=<name>` where the named benchmark, or else the named policy, is of another task than nav.

    A benchmark whose scenes are not those of its task also adds `scene=<name>` where none is named.

    Args:
        arguments: Of the command line.
        key: What names the policy.
    """
    given = {key: value for key, _, value in (argument.partition("=") for argument in arguments)}
    benchmark = BENCHMARKS.get(given.get("benchmark", ""))
    if benchmark is not None and benchmark.scene != find(None, benchmark.task).scene and "scene" not in given:
        arguments = [*arguments, f"scene={benchmark.scene}"]
    if "task" in given:
        return arguments, None
    task, opened = (benchmark.task, None) if benchmark else _task_of(given.get(key, ""), key)
    return arguments if task in (None, _DEFAULT) else [*arguments, f"task={task}"], opened


def _task_of(name: str, key: str) -> tuple[str | None, PolicySource | None]:
    """Find the task of a policy, None if it is of none, and open the policy where there is no quicker way."""
    if name in ("", *UNSAVED):
        return None, None
    try:
        task = task_in_header(find_policy(name))
        opened = None if task else open_policy(name, key)
    except (ConfigError, FileNotFoundError):
        return None, None  # the command itself says what is wrong with it
    return task or (opened and opened.task), opened
