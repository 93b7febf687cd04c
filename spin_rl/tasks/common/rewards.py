"""Reward terms of the navigation task and of all tasks: short functions of what one control step did.

Every term returns shape (num_envs,) and is multiplied by its scale from the configuration. The terms' sources
and the readings of the paper's equation for r_nav are in docs/paper_deviations.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

import torch

from spin_rl import robot

_ARM = slice(robot.DOF_NAMES.index("arm_outer"), robot.DOF_NAMES.index("arm_inner") + 1)
_CAMERA = slice(robot.DOF_NAMES.index("head_pan"), robot.DOF_NAMES.index("head_tilt") + 1)


@dataclass
class Motion:
    """What a control step of any task did, read before worlds that ended were reset.

    Attributes:
        qvel: Generalized velocities [m/s, rad/s], shape (num_envs, nv); the robot's 13 come first.
        success: Whether the task's aim is reached, shape (num_envs,), bool.
        collision: Whether the robot hit what it must not hit, shape (num_envs,), bool.
        action: The action of this step, shape (num_envs, 10).
        last_action: The action before, shape (num_envs, 10).
    """

    qvel: torch.Tensor
    success: torch.Tensor
    collision: torch.Tensor
    action: torch.Tensor
    last_action: torch.Tensor


@dataclass
class Transition(Motion):
    """What a control step of the navigation task did; `success`: at the goal, `collision`: with the scene.

    Attributes:
        progress: Decrease of the path length left to the goal [m], shape (num_envs,).
        goal_distance: Straight distance from the base to the goal [m], shape (num_envs,).
        goal_speed: Base velocity towards the goal [m/s], shape (num_envs,).
        self_contact: Whether the gripper touched the base, shape (num_envs,), bool.
        haste: Largest squared speed of a part of the robot times its nearness to the scene [m^2/s^2] (see
            `sensors.clearance`), zeros where no term needs it, shape (num_envs,).
    """

    progress: torch.Tensor
    goal_distance: torch.Tensor
    goal_speed: torch.Tensor
    self_contact: torch.Tensor
    haste: torch.Tensor


def progress(step: Transition) -> torch.Tensor:
    """Potential-based progress along the corridor [m]."""
    return step.progress


def success(step: Motion) -> torch.Tensor:
    """One on a step at the task's aim: the one that reaches the goal, those that hold the object up."""
    return step.success.float()


def collision(step: Motion) -> torch.Tensor:
    """One on a step that hits what must not be hit."""
    return step.collision.float()


def self_contact(step: Transition) -> torch.Tensor:
    """One on every step in which the gripper rests on the base."""
    return step.self_contact.float()


def time(step: Motion) -> torch.Tensor:
    """One on every step."""
    return torch.ones_like(step.qvel[:, 0])


def goal_distance(step: Transition) -> torch.Tensor:
    """Distance to the goal [m] (paper, r_nav, first term)."""
    return step.goal_distance


def goal_speed(step: Transition) -> torch.Tensor:
    """Speed along the direction of the goal [m/s] (paper, r_nav, second term, |(v_t)_g|)."""
    return step.goal_speed.abs()


def joint_velocity(step: Motion) -> torch.Tensor:
    """Speed of arm stretch and camera joints [m/s + rad/s] (paper, Reward Scales)."""
    # Slices: an index list would be copied to the device in every step.
    return step.qvel[:, _ARM].abs().sum(-1) + step.qvel[:, _CAMERA].abs().sum(-1)


def action_rate(step: Motion) -> torch.Tensor:
    """Squared change of the clipped action since the last step."""
    return (step.action - step.last_action).square().sum(-1)


def clearance(step: Transition) -> torch.Tensor:
    """Squared speed near clutter: of the robot's part with the largest (1 - distance / d0) speed^2 [m^2/s^2].

    Squared, since the sum over an episode of a speed times a nearness is an integral along the path: it says
    where to drive, not how fast. d0 is `task.clearance_m`.
    """
    return step.haste


Term = Callable[[Any], torch.Tensor]
"""From the `Motion` of a task to a value per world, shape (num_envs,)."""

TERMS: dict[str, Term] = {
    "progress": progress,
    "success": success,
    "collision": collision,
    "self_contact": self_contact,
    "time": time,
    "goal_distance": goal_distance,
    "goal_speed": goal_speed,
    "joint_velocity": joint_velocity,
    "action_rate": action_rate,
    "clearance": clearance,
}


def check_scales(scales: dict[str, float], terms: Collection[str] = TERMS) -> dict[str, float]:
    """Return the scales that are not zero.

    Args:
        scales: Scale by term.
        terms: Terms that the task knows.

    Raises:
        ValueError: A term is unknown or a scale is no finite number; the message names the key.
    """
    for name, scale in scales.items():
        if name not in terms:
            raise ValueError(f"reward.{name}: unknown term; choose from {', '.join(terms)}")
        if isinstance(scale, bool) or not isinstance(scale, int | float) or not math.isfinite(scale):
            raise ValueError(f"reward.{name}: the scale must be a finite number, got {scale!r}")
    return {name: float(scale) for name, scale in scales.items() if scale != 0.0}
