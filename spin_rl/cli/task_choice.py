"""Which task a command is about, found before its configuration is composed: tasks have different keys."""

from __future__ import annotations

from spin_rl.benchmark.policies import PolicySource, open_policy
from spin_rl.benchmark.registry import BENCHMARKS, find
from spin_rl.cli.common import Completed
from spin_rl.config import ConfigError
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
    opened = _open(given.get(key, ""), key) if benchmark is None else None
    task = benchmark.task if benchmark is not None else opened and opened.task
    return arguments if task in (None, _DEFAULT) else [*arguments, f"task={task}"], opened


def _open(name: str, key: str) -> PolicySource | None:
    try:
        return open_policy(name, key)
    except ConfigError:
        return None  # the command itself says what is wrong with it
