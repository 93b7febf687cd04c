"""Reward terms of the navigation task, beside those of `common/rewards.py`.

The terms' sources and the readings of the paper's equation for r_nav are in docs/paper_deviations.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from spin_rl.tasks.common import rewards
from spin_rl.tasks.common.rewards import Term, Transition

if TYPE_CHECKING:
    import torch


@dataclass
class NavTransition(Transition):
    """What a control step of the navigation task did; `success`: at the goal, `collision`: with the scene.

    Attributes:
        progress: Decrease of the path length left to the goal [m], shape (num_envs,).
        goal_distance: Straight distance from the base to the goal [m], shape (num_envs,).
        goal_speed: Base velocity towards the goal [m/s], shape (num_envs,).
        self_contact: Whether the gripper touched the base, shape (num_envs,), bool.
        haste: Largest squared speed of a part of the robot times its nearness to the scene [m^2/s^2] (see
            `sensors.clearance`), zeros where no term needs it, shape (num_envs,).
        information: Things that came near in this step and were known, less those that were not (see
            `sensors.awareness`), likewise.
    """

    progress: torch.Tensor
    goal_distance: torch.Tensor
    goal_speed: torch.Tensor
    self_contact: torch.Tensor
    haste: torch.Tensor
    information: torch.Tensor


def progress(step: NavTransition) -> torch.Tensor:
    """Potential-based progress along the corridor [m]."""
    return step.progress


def self_contact(step: NavTransition) -> torch.Tensor:
    """One on every step in which the gripper rests on the base."""
    return step.self_contact.float()


def goal_distance(step: NavTransition) -> torch.Tensor:
    """Distance to the goal [m] (paper, r_nav, first term)."""
    return step.goal_distance


def goal_speed(step: NavTransition) -> torch.Tensor:
    """Speed along the direction of the goal [m/s] (paper, r_nav, second term, |(v_t)_g|)."""
    return step.goal_speed.abs()


def clearance(step: NavTransition) -> torch.Tensor:
    """Squared speed near clutter: of the robot's part with the largest (1 - distance / d0) speed^2 [m^2/s^2].

    Squared, since the sum over an episode of a speed times a nearness is an integral along the path: it says
    where to drive, not how fast. d0 is `task.clearance_m`.
    """
    return step.haste


def information(step: NavTransition) -> torch.Tensor:
    """One for each thing that comes near and that the camera had shown before, minus one for each other.

    So what is seen counts when it comes to matter, and only what does: once an episode for each thing that
    comes nearer to the base than `task.information_m`. Walls are no things.
    """
    return step.information


TERMS: dict[str, Term] = {
    "progress": progress,
    "success": rewards.success,
    "collision": rewards.collision,
    "self_contact": self_contact,
    "time": rewards.time,
    "goal_distance": goal_distance,
    "goal_speed": goal_speed,
    "joint_velocity": rewards.joint_velocity,
    "action_rate": rewards.action_rate,
    "clearance": clearance,
    "information": information,
}
