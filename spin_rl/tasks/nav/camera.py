"""What the camera's actions mean, beside a target for the head: a rate of it, or nothing."""

from __future__ import annotations

import torch

from spin_rl import robot
from spin_rl.tasks.nav.config import NavConfig

_JOINTS = [robot.JOINTS.index(joint) for joint in robot.CAMERA_JOINTS]


class CameraActions:
    """Turns a policy's camera actions into targets of the head."""

    def __init__(self, cfg: NavConfig, device: str) -> None:
        """Prepare constants.

        Args:
            cfg: Task configuration, `camera_action` and `camera_frozen_after_s` of it.
            device: Torch device.
        """
        period = cfg.sim.control_period
        profile = robot.SPEED_PROFILES[cfg.robot_profile]

        def of_head(values: tuple[float, ...]) -> torch.Tensor:
            return torch.tensor([values[joint] for joint in _JOINTS], device=device)

        stowed = torch.tensor([robot.STOWED[joint] for joint in robot.CAMERA_JOINTS], device=device)
        self._above, self._below = of_head(robot.JOINT_UPPER) - stowed, stowed - of_head(robot.JOINT_LOWER)
        self._gaze: torch.Tensor | None = None
        self._moves = None
        if cfg.camera_action == "rate":
            self._moves = of_head(profile.joint_velocity_max) * period
        self._last_step = None
        if cfg.camera_frozen_after_s is not None:
            self._last_step = max(round(cfg.camera_frozen_after_s / period), 1)

    def follow(self, gaze: torch.Tensor) -> None:
        """Let the camera look somewhere else than where the policy says.

        Args:
            gaze: Camera actions, and 1; or zeros: then the head stays as it is. A view, shape (num_envs, 3).
        """
        self._gaze = gaze

    def apply(self, action: torch.Tensor, before: torch.Tensor, step: torch.Tensor) -> None:
        """Replace actions by those that have the head follow its targets.

        Args:
            action: The policy's, in [-1, 1], changed in place, shape (num_envs, 2).
            before: What was executed in the last step, or would hold the start pose, shape (num_envs, 2).
            step: Control steps made in the episode, shape (num_envs,).
        """
        if self._moves is not None:
            target = torch.where(before >= 0.0, before * self._above, before * self._below)
            target = target + self._moves * action
            action.copy_((target / torch.where(target >= 0.0, self._above, self._below)).clamp(-1.0, 1.0))
        if self._gaze is not None:
            action.copy_(torch.where(self._gaze[:, 2:] > 0.0, self._gaze[:, :2], before))
        if self._last_step is not None:
            action.copy_(torch.where((step >= self._last_step)[:, None], before, action))
