"""What whoever runs a policy asks of it, be it to measure it or to show it, and where policies are."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from spin_rl import paths

if TYPE_CHECKING:
    import torch
    from tensordict import TensorDict

METADATA_KEY = "spin_rl"
"""Of a policy file's header, what this project has written there."""


class Policy(Protocol):
    """Turns observations into actions, world by world."""

    def __call__(self, obs: TensorDict) -> torch.Tensor:
        """Return deterministic actions in [-1, 1], shape (num_envs, 10)."""
        ...

    def reset(self, dones: torch.Tensor | None = None) -> None:
        """Clear the recurrent state of the worlds in a mask (num_envs,), or of all."""
        ...


@runtime_checkable
class Entering(Protocol):
    """A policy that does something in an environment before its first episode there, such as mapping it."""

    def enter(self, env: Any) -> None:
        """Get to know the environment that it will act in."""
        ...


PolicyFactory = Callable[["TensorDict", str], Policy]
"""Makes a policy for the observations and device of an environment."""


def make_in(env: Any, make: PolicyFactory) -> Policy:
    """Make the policy that is to act in a task's environment."""
    policy = make(env.get_observations(), env.device)
    if isinstance(policy, Entering):
        policy.enter(env)
    return policy


def find_policy(name_or_path: str | Path) -> Path:
    """Return an existing path as it is, else that of the shipped policy of this name.

    Raises:
        FileNotFoundError: There is neither; the message lists the shipped ones.
    """
    path = Path(name_or_path)
    if path.exists():
        return path
    shipped = paths.POLICY_DIR / f"{name_or_path}.safetensors"
    if shipped.is_file():
        return shipped
    names = ", ".join(sorted(file.stem for file in paths.POLICY_DIR.glob("*.safetensors"))) or "none"
    raise FileNotFoundError(
        f"There is no policy '{name_or_path}': neither a path nor a shipped one ({names})."
    )


def task_in_header(path: Path) -> str | None:
    """Read in a policy file's header which task the policy was trained in, without Torch.

    None for other files, and where the header does not say; whoever opens the policy finds out why.
    """
    import safetensors

    try:
        with safetensors.safe_open(path, framework="numpy") as file:
            config = json.loads((file.metadata() or {})[METADATA_KEY])["config"]
        return str(config["task"]["name"])
    except (safetensors.SafetensorError, OSError, ValueError, KeyError, TypeError):
        return None
