"""What policies are told of the robot and its aims, as functions of plain tensors.

Simulator and robot share them: observations call them with simulator memory, a control loop with what it
measures. All tensors have a leading axis n, worlds or 1. A base pose is x, y [m] and yaw [rad], shape (n, 3);
further columns are not read. Points and frames are in the frame of that pose, whichever it is; with a pose of
zeros, in the base frame.
"""

from __future__ import annotations

from functools import lru_cache

import torch

from spin_rl import robot
from spin_rl.deploy.observations import CLOSE_PER_M, NEAR_PER_M

GOAL_SCALE_M = 2.5


@lru_cache(maxsize=8)
def _joint_scales(device: torch.device) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Middle and half of every joint's range, and its speed limit, on a device."""
    lower = torch.tensor(robot.JOINT_LOWER, device=device)
    upper = torch.tensor(robot.JOINT_UPPER, device=device)
    # The fastest profile's, so that policies of both profiles read the same units.
    speed = torch.tensor(robot.SPEED_PROFILES["paper"].joint_velocity_max, device=device)
    return (lower + upper) / 2, (upper - lower) / 2, speed


def joint_position(joints: torch.Tensor) -> torch.Tensor:
    """Scale positions in `robot.JOINTS` order [m or rad] to -1 and 1 at the joints' limits, shape (n, 8)."""
    middle, half_range, _ = _joint_scales(joints.device)
    return (joints - middle) / half_range


def joint_velocity(velocity: torch.Tensor) -> torch.Tensor:
    """Divide velocities in `robot.JOINTS` order [m/s or rad/s] by the joints' speed limits, shape (n, 8)."""
    return velocity / _joint_scales(velocity.device)[2]


def proprio(
    position: torch.Tensor,
    velocity: torch.Tensor,
    base_velocity: torch.Tensor,
    grasp_centre_b: torch.Tensor,
    last_action: torch.Tensor,
) -> torch.Tensor:
    """Return the group `proprio`, shape (n, 31).

    Args:
        position: `joint_position`, shape (n, 8).
        velocity: `joint_velocity`, shape (n, 8).
        base_velocity: Forward [m/s] and turning [rad/s], shape (n, 2).
        grasp_centre_b: Between the fingertips, in the base frame [m], shape (n, 3).
        last_action: In [-1, 1], `robot.ACTIONS` order, shape (n, 10).
    """
    return torch.cat((position, velocity, base_velocity, grasp_centre_b, last_action), -1)


def goal(goal_b: torch.Tensor, farthest: float | None = None) -> torch.Tensor:
    """Return the group `goal`, shape (n, 3), of a goal in the base frame [m], shape (n, 2).

    A goal farther away than `farthest` [m] is told as that far, in its direction.
    """
    if farthest is not None:
        goal_b = goal_b * (farthest / goal_b.norm(dim=-1, keepdim=True).clamp_min(farthest))
    return torch.cat((goal_b, goal_b.norm(dim=-1, keepdim=True)), -1) / GOAL_SCALE_M


def hand(gripper: torch.Tensor, base: torch.Tensor, grip: torch.Tensor) -> torch.Tensor:
    """Return the group `hand`, shape (n, 7).

    Args:
        gripper: Orientation of the grasp centre, axes as columns, shape (n, 3, 3).
        base: Pose of the base.
        grip: Target of the fingers minus where they are [rad], shape (n, 1).
    """
    yaw = base[:, 2:3]
    axes = (gripper[:, :, 0], gripper[:, :, 2])
    return torch.cat([part for a in axes for part in (rotate(a[:, :2], yaw), a[:, 2:3])] + [grip], -1)


def seen_object(
    at: torch.Tensor, base: torch.Tensor, grasp_centre: torch.Tensor, gripper: torch.Tensor
) -> torch.Tensor:
    """Return the group `object` of an object in sight, shape (n, 10); out of sight it is 0.

    Args:
        at: Where it is [m], shape (n, 3).
        base: Pose of the base.
        grasp_centre: Between the fingertips [m], shape (n, 3).
        gripper: Orientation of the grasp centre, axes as columns, shape (n, 3, 3).
    """
    offset = turned_back(gripper, at - grasp_centre)
    return torch.cat(
        (
            torch.ones_like(offset[:, :1]),
            in_base(at, base),
            (NEAR_PER_M * offset).clamp(-1.0, 1.0),
            (CLOSE_PER_M * offset).clamp(-1.0, 1.0),
        ),
        -1,
    )


def in_base(point: torch.Tensor, base: torch.Tensor) -> torch.Tensor:
    """Turn points [m], shape (n, 2) or (n, 3), into the frame of a base pose."""
    across = rotate(point[:, :2] - base[:, :2], base[:, 2:3])
    return across if point.shape[1] == 2 else torch.cat((across, point[:, 2:3]), -1)


def rotate(vector: torch.Tensor, yaw: torch.Tensor) -> torch.Tensor:
    """Turn vectors (n, 2) back by yaws (n, 1): into the frame of a base with that yaw."""
    x, y = vector[:, :1], vector[:, 1:2]
    cos, sin = yaw.cos(), yaw.sin()
    return torch.cat((cos * x + sin * y, cos * y - sin * x), -1)


def turned_back(rotation: torch.Tensor, vector: torch.Tensor) -> torch.Tensor:
    """Turn vectors (n, 3) into frames whose axes are columns, (n, 3, 3)."""
    return (rotation * vector[:, :, None]).sum(1)
