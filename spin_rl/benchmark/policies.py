"""What can be evaluated: policy files, and two that learned nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from tensordict import TensorDict

from spin_rl import robot
from spin_rl.benchmark import settings
from spin_rl.config import ConfigError
from spin_rl.policy import PolicyFactory
from spin_rl.runners import policy_file
from spin_rl.tasks.fetch.policy import FetchPolicy

UNTRAINED = ("zero", "random")
PICKERS = {False: "pick-teacher", True: "pick-depth"}
"""Which shipped policy picks in a fetch, by whether the one that drives reads images."""


class ZeroPolicy:
    """Stands still."""

    def __call__(self, obs: TensorDict) -> torch.Tensor:
        """Return zeros, shape (num_envs, 10)."""
        return torch.zeros(obs.batch_size[0], len(robot.ACTIONS), device=obs.device)

    def reset(self, dones: torch.Tensor | None = None) -> None:
        """Do nothing: there is no state."""


class RandomPolicy(ZeroPolicy):
    """Draws every action uniformly from [-1, 1]."""

    def __init__(self, device: str, seed: int = 0) -> None:
        self._rng = torch.Generator(device).manual_seed(seed)

    def __call__(self, obs: TensorDict) -> torch.Tensor:
        """Return actions, shape (num_envs, 10)."""
        shape = (obs.batch_size[0], len(robot.ACTIONS))
        return torch.rand(shape, generator=self._rng, device=self._rng.device) * 2.0 - 1.0


def open_policy(name: str) -> tuple[PolicyFactory, dict[str, Any]]:
    """Find a policy.

    Args:
        name: Shipped policy, checkpoint, run directory, .safetensors file, `zero` or `random`.

    Returns:
        A function that makes the policy for an environment, and the configuration that it was trained with
        (empty for `zero` and `random`).

    Raises:
        ConfigError: There is no such policy, or it is damaged.
    """
    if name == "zero":
        return lambda obs, device: ZeroPolicy(), {}
    if name == "random":
        return lambda obs, device: RandomPolicy(device), {}
    try:
        metadata = policy_file.read_policy(name)[1]
    except FileNotFoundError as error:
        untrained = "" if Path(name).exists() else f" Always there: {', '.join(UNTRAINED)}."
        raise ConfigError(f"policy: {error}{untrained}") from None
    except ValueError as error:
        raise ConfigError(f"policy: {error}") from None
    return (
        lambda obs, device: policy_file.load_policy(name, obs, device),
        metadata["config"],
    )


def open_fetch_policy(nav: str, pick: str | None) -> tuple[PolicyFactory, dict[str, Any], str]:
    """Find the two policies of a fetch.

    Args:
        nav: The one that drives, as of `open_policy`.
        pick: The one that picks; None takes the shipped one that sees what `nav` sees, images or the object.

    Returns:
        A function that makes the `FetchPolicy`, what the two were trained with (see `settings.of_fetch`), and
        the name of the one that picks.

    Raises:
        ConfigError: There is no such policy, one is of another task, or they do not fit each other.
    """
    make_nav, nav_trained = open_policy(nav)
    if pick is None:
        pick = PICKERS[bool(nav_trained.get("task", {}).get("depth", {}).get("enabled"))]
    try:
        make_pick, pick_trained = open_policy(pick)
    except ConfigError as error:
        raise ConfigError(str(error).replace("policy:", "pick:", 1)) from None
    for key, name, trained, task in (
        ("policy", nav, nav_trained, "nav"),
        ("pick", pick, pick_trained, "pick"),
    ):
        own = trained.get("task", {}).get("name", task)
        if own != task:
            raise ConfigError(f"{key}: {name} was trained with task={own}; a fetch needs one of task={task}")
    return (
        lambda obs, device: FetchPolicy(make_nav(obs, device), make_pick(obs, device)),
        settings.of_fetch(nav_trained, pick_trained),
        pick,
    )
