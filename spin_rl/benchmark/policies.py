"""What can be evaluated: policy files, baselines, and what learned nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from spin_rl.baselines.registry import BASELINES
from spin_rl.benchmark import settings
from spin_rl.config import ConfigError
from spin_rl.deferred import Deferred
from spin_rl.policy import PolicyFactory, find_policy
from spin_rl.tasks.common.config import TaskConfig
from spin_rl.tasks.registry import TaskSpec

SHIPPED = {"pick": {False: "pick-teacher", True: "pick-depth"}}
"""Key -> which shipped policy that is if none is named, by whether the one that drives reads images."""


UNTRAINED: Mapping[str, PolicyFactory] = MappingProxyType(
    {
        "zero": lambda obs, device: Deferred("spin_rl.benchmark.untrained:ZeroPolicy")(),
        "random": lambda obs, device: Deferred("spin_rl.benchmark.untrained:RandomPolicy")(device),
    }
)
"""What acts in any task without having learned, by name."""

UNSAVED = (*UNTRAINED, *BASELINES)
"""Names of policies that are no files."""


@dataclass(frozen=True)
class PolicySource:
    """What acts in a task, opened once: a policy, or several that take turns.

    Attributes:
        names: Name or path of each policy by the key that names it on a command line, `policy` first.
        trained: Configuration that it was trained with, nested; empty for one that learned nothing. Of
            several see `settings.of_fetch`.
        make: Makes the policy for the observations and device of an environment.
    """

    names: Mapping[str, str]
    trained: Mapping[str, Any]
    make: PolicyFactory

    @property
    def task(self) -> str | None:
        """Name of the task that it was trained in; None where there was no training."""
        return self.trained.get("task", {}).get("name")

    def check(self, task: TaskConfig) -> None:
        """Reject a task's configuration in which it cannot act.

        Raises:
            ConfigError: One line that names the key.
        """
        for name in self.names.values():
            if name in BASELINES:
                BASELINES[name].check(name, task)


def open_policy(name: str, key: str = "policy") -> PolicySource:
    """Find a policy.

    Args:
        name: Shipped policy, checkpoint, run directory, .safetensors file, or one of `UNSAVED`.
        key: What names it on the command line.

    Raises:
        ConfigError: There is no such policy, or it is damaged.
    """
    check_name(name, key)
    if name in UNTRAINED:
        return PolicySource({key: name}, {}, UNTRAINED[name])
    if name in BASELINES:
        return PolicySource({key: name}, BASELINES[name].needs, BASELINES[name].make)
    from spin_rl.runners.policy_file import read_policy

    try:
        policy = read_policy(name)
    except (FileNotFoundError, ValueError) as error:
        raise ConfigError(f"{key}: {error}") from None
    return PolicySource({key: name}, policy.config, policy.build)


def check_name(name: str, key: str = "policy") -> None:
    """Reject the name of a policy that there is none of, before Torch is imported.

    Raises:
        ConfigError: One line that names the key and the shipped policies.
    """
    if name in UNSAVED:
        return
    try:
        find_policy(name)
    except FileNotFoundError as error:
        raise ConfigError(f"{key}: {error} Always there: {', '.join(UNSAVED)}.") from None


def open_for(
    spec: TaskSpec, names: Mapping[str, str | None], opened: PolicySource | None = None
) -> PolicySource:
    """Find the policies that take turns in a task, or the one that acts in it alone.

    Args:
        spec: The task.
        names: Name or path of each by the key of `spec.policies`; None takes the shipped one that sees what
            the first one sees, images or not.
        opened: The first one, where it has been opened already.

    Raises:
        ConfigError: There is no such policy, one is of another task, or they do not fit each other.
    """
    sources: list[PolicySource] = []
    for key, task in spec.policies.items():
        name = names[key] or SHIPPED[key][reads_images(sources[0])]
        if opened is not None and opened.names == {key: name}:
            source = opened
        else:
            source = open_policy(name, key)
        check_task(key, name, source.task, task, spec.name)
        if name in BASELINES and len(spec.policies) > 1:
            raise ConfigError(f"{key}: {name} takes no turns with others, as task={spec.name} needs")
        sources.append(source)
    if len(sources) == 1:
        return sources[0]
    return PolicySource(
        {key: name for source in sources for key, name in source.names.items()},
        settings.of_fetch(*(source.trained for source in sources)),
        lambda obs, device: spec.join(
            *(source.make(obs, device) for source in sources), settings.told_pose(sources[0].trained)
        ),
    )


def of_task(spec: TaskSpec) -> tuple[str, ...]:
    """Names of the policies that are no files and can act in a task."""
    own = [name for name, baseline in BASELINES.items() if list(spec.policies.values()) == [baseline.task]]
    return (*own, *UNTRAINED)


def reads_images(source: PolicySource) -> bool:
    """Whether a policy was trained on depth images."""
    return bool(source.trained.get("task", {}).get("depth", {}).get("enabled"))


def check_task(key: str, name: str, own: str | None, wanted: str, task: str) -> None:
    """Reject a policy of another task.

    Args:
        key: What names it on the command line.
        name: Its name.
        own: The task that it was trained in; None where there was no training.
        wanted: The task that it should have been trained in.
        task: The task of the command, in which it acts.

    Raises:
        ConfigError: It was trained in another task.
    """
    if own in (None, wanted):
        return
    needs = f", which is not task={task}" if wanted == task else f"; a {task} needs one of task={wanted}"
    relation = "acts in" if name in BASELINES else "was trained with"
    raise ConfigError(f"{key}: {name} {relation} task={own}{needs}")
