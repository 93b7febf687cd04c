"""SPIN: simultaneous perception, interaction and navigation for a Stretch RE1 in MuJoCo Warp."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from spin_rl.tasks.common.config import TaskConfig

__version__ = "0.1.0"


def training_config(task: str = "nav", overrides: Sequence[str] = ()) -> TaskConfig:
    """Return the configuration in which `spin-train` lets a task be learned: levels, noise, drawn dynamics.

    Args:
        task: Name of the task.
        overrides: As on the command line, such as `reward=paper`.

    Raises:
        ConfigError: An override does not fit.
    """
    from spin_rl.tasks.registry import find_task

    return find_task(task).as_trained(overrides)


def evaluation_config(
    task: str = "nav", overrides: Sequence[str] = (), policy: str | None = None
) -> TaskConfig:
    """Return the configuration in which `spin-eval` measures a task: nominal, without noise, at level 1.

    Args:
        task: Name of the task.
        overrides: As on the command line, such as `task.difficulty=2`.
        policy: Policy to be measured, any that `spin-eval policy=` takes; camera, robot and inputs are then
            those that it was trained with, unless they are overridden.

    Raises:
        ConfigError: An override does not fit, or there is no such policy.
    """
    from spin_rl.benchmark import policies, settings
    from spin_rl.tasks.common.compose import compose
    from spin_rl.tasks.registry import find_task

    trained: Any = {} if policy is None else policies.open_policy(policy).trained
    values = compose("eval", [f"task={task}", *overrides])
    return find_task(task).configure(settings.for_policy(values, trained, overrides))
