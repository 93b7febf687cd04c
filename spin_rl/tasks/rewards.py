"""Reward terms of the navigation task: short functions of what one control step did.

Every term returns shape (num_envs,) and is multiplied by its scale from the configuration. The terms' sources
and the readings of the paper's equation for r_nav are in docs/paper_deviations.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch

from spin_rl import robot

_ARM = slice(robot.DOF_NAMES.index("arm_outer"), robot.DOF_NAMES.index("arm_inner") + 1)
_CAMERA = slice(robot.DOF_NAMES.index("head_pan"), robot.DOF_NAMES.index("head_tilt") + 1)


@dataclass
class Transition:
    """What a control step did, read before worlds that ended were reset.

    Attributes:
        progress: Decrease of the path length left to the goal [m], shape (num_envs,).
        goal_distance: Straight distance from the base to the goal [m], shape (num_envs,).
        goal_speed: Base velocity towards the goal [m/s], shape (num_envs,).
        qvel: Generalized velocities [m/s, rad/s], shape (num_envs, 13).
        success: Whether the goal was reached, shape (num_envs,), bool.
        collision: Whether a part touched the scene, shape (num_envs,), bool.
        self_contact: Whether the gripper touched the base, shape (num_envs,), bool.
        action: The action of this step, shape (num_envs, 10).
        last_action: The action before, shape (num_envs, 10).
        haste: Largest squared speed of a part of the robot times its nearness to the scene [m^2/s^2] (see
            `sensors.clearance`), zeros where no term needs it, shape (num_envs,).
    """

    progress: torch.Tensor
    goal_distance: torch.Tensor
    goal_speed: torch.Tensor
    qvel: torch.Tensor
    success: torch.Tensor
    collision: torch.Tensor
    self_contact: torch.Tensor
    action: torch.Tensor
    last_action: torch.Tensor
    haste: torch.Tensor


def progress(step: Transition) -> torch.Tensor:
    """Potential-based progress along the corridor [m]."""
    return step.progress


def success(step: Transition) -> torch.Tensor:
    """One on the step that reaches the goal."""
    return step.success.float()


def collision(step: Transition) -> torch.Tensor:
    """One on the step that touches the scene."""
    return step.collision.float()


def self_contact(step: Transition) -> torch.Tensor:
    """One on every step in which the gripper rests on the base."""
    return step.self_contact.float()


def time(step: Transition) -> torch.Tensor:
    """One on every step."""
    return torch.ones_like(step.progress)


def goal_distance(step: Transition) -> torch.Tensor:
    """Distance to the goal [m] (paper, r_nav, first term)."""
    return step.goal_distance


def goal_speed(step: Transition) -> torch.Tensor:
    """Speed along the direction of the goal [m/s] (paper, r_nav, second term, |(v_t)_g|)."""
    return step.goal_speed.abs()


def joint_velocity(step: Transition) -> torch.Tensor:
    """Speed of arm stretch and camera joints [m/s + rad/s] (paper, Reward Scales)."""
    # Slices: an index list would be copied to the device in every step.
    return step.qvel[:, _ARM].abs().sum(-1) + step.qvel[:, _CAMERA].abs().sum(-1)


def action_rate(step: Transition) -> torch.Tensor:
    """Squared change of the clipped action since the last step."""
    return (step.action - step.last_action).square().sum(-1)


def clearance(step: Transition) -> torch.Tensor:
    """Squared speed near clutter: of the robot's part with the largest (1 - distance / d0) speed^2 [m^2/s^2].

    Squared, since the sum over an episode of a speed times a nearness is an integral along the path: it says
    where to drive, not how fast. d0 is `task.clearance_m`.
    """
    return step.haste


TERMS: dict[str, Callable[[Transition], torch.Tensor]] = {
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


def check_scales(scales: dict[str, float]) -> dict[str, float]:
    """Return the scales that are not zero; raise a ValueError that names an unknown term or a bad scale."""
    for name, scale in scales.items():
        if name not in TERMS:
            raise ValueError(f"reward.{name}: unknown term; choose from {', '.join(TERMS)}")
        if isinstance(scale, bool) or not isinstance(scale, int | float) or not math.isfinite(scale):
            raise ValueError(f"reward.{name}: the scale must be a finite number, got {scale!r}")
    return {name: float(scale) for name, scale in scales.items() if scale != 0.0}
