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
    from spin_rl.cli.refusals import in_one_line
    from spin_rl.tasks.registry import find_task

    spec = find_task(task)
    with in_one_line("train", [f"task={task}"]):
        return spec.as_trained(_listed(overrides))


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
    from spin_rl.cli.refusals import in_one_line
    from spin_rl.tasks.common.compose import compose
    from spin_rl.tasks.registry import find_task

    spec = find_task(task)
    trained: Any = {}
    if policy is not None:
        source = policies.open_policy(policy)
        policies.check_task("policy", policy, source.task, spec.policies["policy"], task)
        trained = source.trained
    with in_one_line("eval", [f"task={task}"]):
        values = compose("eval", [f"task={task}", *_listed(overrides)])
    return spec.configure(settings.for_policy(values, trained, overrides))


def _listed(overrides: Sequence[str]) -> list[str]:
    from spin_rl.config import ConfigError

    if isinstance(overrides, str) or not all(isinstance(override, str) for override in overrides):
        raise ConfigError(f"overrides: expected a list such as ['robot=re1'], got {overrides!r}")
    return list(overrides)
