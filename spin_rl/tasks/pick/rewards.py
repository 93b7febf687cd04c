"""Reward terms of the pick task, as in `rewards.py`; which scales make which reward is in docs/pick.md."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from spin_rl.tasks.common import rewards
from spin_rl.tasks.common.rewards import Term, Transition

if TYPE_CHECKING:
    import torch

REACH_PER_M = 5.0
FINE_PER_M = 20.0
LIFT_M = 0.12
"""Height at which `lift` is 1 [m]."""
CLOSED_RAD, OPEN_RAD = 0.6, 0.4
"""Finger angles at which `close` is 0 and `open` is 1 [rad]."""
TABLE_FORCE_N = 20.0
PAPER_LIFT_M = 0.15
PAPER_PER_M = 15.0


@dataclass
class PickTransition(Transition):
    """What a control step did; `success`: held up long enough, `collision`: a part but the fingers hit.

    Attributes:
        distance: From the grasp centre to the object's centre [m], shape (num_envs,).
        height: Height of the object's centre over its start [m], shape (num_envs,).
        finger: Mean angle of the two fingers [rad], shape (num_envs,).
        finger_force: Force of the left and the right fingertip on the object [N], shape (num_envs, 2).
        table_force: Force of the fingers on the scene [N], shape (num_envs,).
        hard_peak: Largest force of the other parts on the scene so far in the episode [N], shape
            (num_envs,).
        inside: Whether the object is between the fingers, shape (num_envs,), bool.
        grasped: Whether both fingers press on the object, hard enough together, shape (num_envs,), bool.
        pressed: Whether the fingers together press hard enough, shape (num_envs,), bool.
        dropped: Whether the object fell from the table, shape (num_envs,), bool.
    """

    distance: torch.Tensor
    height: torch.Tensor
    finger: torch.Tensor
    finger_force: torch.Tensor
    table_force: torch.Tensor
    hard_peak: torch.Tensor
    inside: torch.Tensor
    grasped: torch.Tensor
    pressed: torch.Tensor
    dropped: torch.Tensor


def reach(step: PickTransition) -> torch.Tensor:
    """Nearness of the gripper to the object, 1 at it and 0 far away."""
    return 1.0 - (REACH_PER_M * step.distance).tanh()


def reach_fine(step: PickTransition) -> torch.Tensor:
    """The same within a few centimetres."""
    return 1.0 - (FINE_PER_M * step.distance).tanh()


def touch(step: PickTransition) -> torch.Tensor:
    """Number of fingertips on the object."""
    return (step.finger_force > 0.0).float().sum(-1)


def grasp(step: PickTransition) -> torch.Tensor:
    """One while the object is grasped."""
    return step.grasped.float()


def close(step: PickTransition) -> torch.Tensor:
    """How far the fingers are closed, around the object only."""
    return step.inside.float() * (1.0 - step.finger / CLOSED_RAD)


def open_(step: PickTransition) -> torch.Tensor:
    """How far the fingers are open, away from the object only."""
    return (~step.inside).float() * (step.finger / OPEN_RAD).clamp(max=1.0)


def lift(step: PickTransition) -> torch.Tensor:
    """Height of the grasped object, 1 from LIFT_M on."""
    return step.grasped.float() * (step.height / LIFT_M).clamp(0.0, 1.0)


def table_force(step: PickTransition) -> torch.Tensor:
    """How hard the fingers press on the table, below 1."""
    return (step.table_force / TABLE_FORCE_N).tanh()


def dropped(step: PickTransition) -> torch.Tensor:
    """One on the step in which the object falls from the table."""
    return step.dropped.float()


def lift_paper(step: PickTransition) -> torch.Tensor:
    """Nearness of the grasped object to PAPER_LIFT_M above its start (appendix: "to a certain height")."""
    return step.grasped.float() * (1.0 - (PAPER_PER_M * (PAPER_LIFT_M - step.height).clamp(min=0.0)).tanh())


def distance(step: PickTransition) -> torch.Tensor:
    """Distance to the object [m] (paper, r_pick, first term)."""
    return step.distance


def low_paper(step: PickTransition) -> torch.Tensor:
    """r_lift as printed: nearness of the pressed object to its start's height, above it."""
    return step.pressed.float() * (1.0 - (PAPER_PER_M * step.height.clamp(min=0.0)).tanh())


TERMS: dict[str, Term] = {
    "reach": reach,
    "reach_fine": reach_fine,
    "touch": touch,
    "grasp": grasp,
    "close": close,
    "open": open_,
    "lift": lift,
    "success": rewards.success,
    "collision": rewards.collision,
    "dropped": dropped,
    "table_force": table_force,
    "action_rate": rewards.action_rate,
    "joint_velocity": rewards.joint_velocity,
    "time": rewards.time,
    "lift_paper": lift_paper,
    "distance": distance,
    "low_paper": low_paper,
}
