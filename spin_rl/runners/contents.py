"""What checkpoints and policy files must hold, and within which bounds: they may come from anywhere."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

import torch

from spin_rl.config import Length, Range, check_value, from_keys, from_mapping

LARGEST_WEIGHT = 1e6
"""Of parameters and of a normalizer's statistics: beyond it a model computes nothing of use."""

Dims = dict[str, Annotated[int, Range(1, 100_000)]]
Counter = Annotated[int, Range(0, 10**15)]

# What of a run's configuration is read again later; each is a mapping where it is there.
_SECTIONS = (
    *("task", "task.scandots", "task.map", "task.sight", "task.manipulation", "task.depth"),
    *("task.guard", "task.planner", "task.lidar", "task.odometry"),
    *("depth", "depth.filter", "robot", "runner", "runner.obs_groups", "runner.algorithm"),
)


@dataclass(frozen=True, kw_only=True)
class Progress:
    """How far a training has come."""

    iteration: Counter
    env_steps: Counter
    minutes: Annotated[float, Range(0.0, 1e9)]


@dataclass(frozen=True, kw_only=True)
class ProcessState:
    """What a checkpoint holds of each process."""

    env: dict[str, Any]
    rng_cpu: torch.Tensor
    rng_cuda: torch.Tensor | None
    memory: tuple[tuple[torch.Tensor, ...] | None, ...]


@dataclass(frozen=True, kw_only=True)
class Checkpoint(Progress):
    """What a checkpoint holds beside the weights of its models."""

    skipped_steps: Counter
    learning_rate: Annotated[float, Range(0.0, 1.0, above=True)]
    num_actions: Annotated[int, Range(1, 1000)]
    obs_dims: Dims
    config: str
    optimizer: dict[str, Any]
    processes: Annotated[tuple[ProcessState, ...], Length(1, 100_000)]
    algorithm: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class PolicyMetadata(Progress):
    """What a policy file holds beside its weights; see `policy_file.TrainedPolicy`."""

    version: int
    obs_groups: tuple[str, ...]
    obs_dims: Dims
    num_actions: Annotated[int, Range(1, 1000)]
    actor: dict[str, Any]
    config: dict[str, Any] | None
    facts: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class _Config:
    """The configuration inside a checkpoint: of the runner, and of the whole run if that was given."""

    runner: dict[str, Any]
    run: dict[str, Any] | None


@dataclass(frozen=True, kw_only=True)
class RunnerSections:
    """What of a runner's configuration is needed to build its models again."""

    obs_groups: dict[str, tuple[str, ...]]
    actor: dict[str, Any]
    critic: dict[str, Any] | None = None


def check_checkpoint(state: Mapping[str, Any], source: str) -> tuple[RunnerSections, dict[str, Any]]:
    """Check everything of a checkpoint but whether it fits a run.

    Args:
        state: What `checkpoint.load_checkpoint` returned.
        source: The file, for messages.

    Returns:
        Of the configuration in it, what describes the models, and the run's own, empty if none was given.

    Raises:
        ValueError: One line that names the file and the key.
    """
    try:
        checkpoint = from_keys(Checkpoint, state)
        try:
            content = json.loads(checkpoint.config)
        except (ValueError, RecursionError):
            raise ValueError("config: expected JSON") from None
        config = from_mapping(_Config, content, "config")
        runner = from_keys(RunnerSections, config.runner, "config.runner")
        check_run(config.run)
        for name in ("actor", "critic"):
            if name == "actor" or name in state:
                check_weights(state.get(name), name)
        _check_finite(checkpoint.optimizer, "optimizer")
        _check_finite([process.env for process in checkpoint.processes], "processes")
        _check_described(runner.obs_groups.get("actor", ()), checkpoint.obs_dims)
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from None
    return runner, config.run or {}


def check_policy(weights: Mapping[str, torch.Tensor], metadata: Any, source: str) -> None:
    """Check a policy file's weights and metadata.

    Raises:
        ValueError: One line that names the file and the key.
    """
    try:
        checked = from_mapping(PolicyMetadata, check_value(dict[str, Any], metadata, "metadata"))
        check_run(checked.config)
        _check_described(checked.obs_groups, checked.obs_dims)
        check_weights(weights, "weights")
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from None


def check_weights(weights: Any, name: str) -> None:
    """Check the values of a model's parameters and buffers.

    Raises:
        ValueError: They are none, or not finite or too large; one line that names the first.
    """
    for key, value in check_value(dict[str, torch.Tensor], weights, name).items():
        if value.is_floating_point() and value.numel():
            largest = value.detach().abs().max().item()
            if not largest <= LARGEST_WEIGHT:
                what = "is not finite" if not math.isfinite(largest) else f"holds {largest:.3g}"
                raise ValueError(f"{name}.{key} {what}")
        if key.endswith(("_var", "_std", "count")) and value.numel() and value.min() < 0:
            raise ValueError(f"{name}.{key} is negative")


def check_run(config: Mapping[str, Any] | None) -> None:
    """Check the form of a run's configuration, as far as it is read without the checks of a task.

    Raises:
        ValueError: One line that names the key.
    """
    for section in _SECTIONS if config is not None else ():
        value: Any = config
        for name in section.split("."):
            value = value.get(name, {})
            check_value(dict[str, Any], value, f"config.{section}")
    task = {} if config is None else config.get("task", {})
    check_value(str | None, task.get("name"), "config.task.name")
    groups = {} if config is None else config.get("runner", {}).get("obs_groups", {})
    check_value(dict[str, tuple[str, ...]], groups, "config.runner.obs_groups")


def _check_described(groups: tuple[str, ...], dims: Mapping[str, int]) -> None:
    if not groups:
        raise ValueError("obs_groups: expected the groups that the actor reads")
    for group in groups:
        if group not in dims:
            raise ValueError(f"obs_dims.{group}: a value is needed")


def _check_finite(value: Any, name: str) -> None:
    for where, number in _numbers(value, name):
        if not math.isfinite(number):
            raise ValueError(f"{where} is not finite")


def _numbers(value: Any, name: str) -> Iterator[tuple[str, float]]:
    """All numbers of nested containers, of each tensor the sum, with where they stand."""
    if isinstance(value, torch.Tensor):
        if value.is_floating_point():
            yield name, value.double().sum().item()
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield from _numbers(item, f"{name}.{key}")
    elif isinstance(value, list | tuple):
        for index, item in enumerate(value):
            yield from _numbers(item, f"{name}[{index}]")
    elif isinstance(value, float):
        yield name, value
