"""Reward terms that tasks share: short functions of what one control step did.

Every term returns shape (num_envs,) and is multiplied by its scale from the configuration.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

from spin_rl import robot
from spin_rl.config import LARGEST, short

if TYPE_CHECKING:
    import torch
    from tensordict import TensorDict

_ARM = slice(robot.DOF_NAMES.index("arm_outer"), robot.DOF_NAMES.index("arm_inner") + 1)
_CAMERA = slice(robot.DOF_NAMES.index("head_pan"), robot.DOF_NAMES.index("head_tilt") + 1)


@dataclass
class Transition:
    """What a control step of any task did, read before worlds that ended were reset.

    Attributes:
        qvel: Generalized velocities [m/s, rad/s], shape (num_envs, nv); the robot's 13 come first.
        success: Whether the task's aim is reached, shape (num_envs,), bool.
        collision: Whether the robot hit what it must not hit, shape (num_envs,), bool.
        action: The action of this step, shape (num_envs, 10).
        last_action: The action before, shape (num_envs, 10).
        observations: What the policy saw when it chose the action: the task's observation groups with their
            noise, each of shape (num_envs, width).
    """

    qvel: torch.Tensor
    success: torch.Tensor
    collision: torch.Tensor
    action: torch.Tensor
    last_action: torch.Tensor
    observations: TensorDict


def success(step: Transition) -> torch.Tensor:
    """One on a step at the task's aim: the one that reaches the goal, those that hold the object up."""
    return step.success.float()


def collision(step: Transition) -> torch.Tensor:
    """One on a step that hits what must not be hit."""
    return step.collision.float()


def time(step: Transition) -> torch.Tensor:
    """One on every step."""
    return step.qvel.new_ones(step.qvel.shape[0])


def joint_velocity(step: Transition) -> torch.Tensor:
    """Speed of arm stretch and camera joints [m/s + rad/s] (paper, Reward Scales)."""
    # Slices: an index list would be copied to the device in every step.
    return step.qvel[:, _ARM].abs().sum(-1) + step.qvel[:, _CAMERA].abs().sum(-1)


def action_rate(step: Transition) -> torch.Tensor:
    """Squared change of the clipped action since the last step."""
    return (step.action - step.last_action).square().sum(-1)


Term = Callable[[Any], "torch.Tensor"]
"""From the `Transition` of a task to a value per world, shape (num_envs,)."""


def outside_term(name: str) -> Term:
    """Import a term by its full name, such as `my_package.my_module.term`.

    Raises:
        ValueError: There is none; one line that names the key. So does the term, where it does not return a
            value per world.
    """
    try:
        term = resolve_name(name)
    except Exception as error:  # whatever the module does when it is imported
        raise ValueError(f"reward.{name}: cannot be imported: {type(error).__name__}: {error}") from error
    if not callable(term):
        raise ValueError(f"reward.{name}: expected a function of a step, got {short(term)}")

    def checked(step: Transition) -> torch.Tensor:
        value: Any = term(step)
        wanted = tuple(step.success.shape)
        shape = getattr(value, "shape", None)
        if shape is None or tuple(shape) != wanted:
            got = type(value).__name__ if shape is None else tuple(shape)
            raise ValueError(f"reward.{name}: expected a value per world, shape {wanted}, got {got}")
        return value

    return checked


def check_scales(scales: dict[str, float], terms: Collection[str]) -> dict[str, float]:
    """Return the scales that are not zero; what is not a term of the task is imported by its full name.

    Args:
        scales: Scale by term.
        terms: Terms that the task knows.

    Raises:
        ValueError: A term is unknown or a scale is no finite number; the message names the key.
    """
    for name, scale in scales.items():
        if name not in terms and "." not in name:
            raise ValueError(f"reward.{name}: unknown term; choose from {', '.join(terms)}")
        if name not in terms:
            outside_term(name)
        is_number = isinstance(scale, int | float) and not isinstance(scale, bool)
        if not is_number or not abs(scale) <= LARGEST:
            raise ValueError(f"reward.{name}: the scale must be a finite number, got {short(scale)}")
    return {name: float(scale) for name, scale in scales.items() if scale != 0.0}
