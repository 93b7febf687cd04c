"""PPO whose camera also imitates where a camera looks that knows what it has not seen yet."""

from __future__ import annotations

from typing import Any

import torch
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from spin_rl.ranges import Share, Weight
from spin_rl.runners.interface import Camera
from spin_rl.runners.ppo.algorithm import PPO
from spin_rl.runners.ppo.fading import FadingPPO
from spin_rl.runners.ppo.storage import Batch

GROUP = "gaze"
"""Observation group with the camera actions to imitate, and with 1 where there are some."""


class GazePPO(FadingPPO):
    """PPO with a supervised loss on the camera's mean actions, which fades out.

    The loss is the mean squared error to the group `gaze` where that says something. No model reads the
    group, since it tells of things that the camera has not shown. The camera's actions are the environment's
    last ones.
    """

    def __init__(
        self, *args: Any, gaze_loss: Weight = 0.5, gaze_anneal: Share = 0.5, **settings: Any
    ) -> None:
        """Initialize as PPO.

        Args:
            args: As of PPO.
            gaze_loss: Weight of the supervised loss at the start.
            gaze_anneal: Part of the run over which that weight falls to zero, linearly.
            settings: As of PPO.
        """
        super().__init__(*args, **settings)
        self.fading_loss, self.fading_part = gaze_loss, gaze_anneal
        self.storage.targets = self.storage.actions.new_zeros(*self.storage.dones.shape, 3)

    @staticmethod
    def construct_algorithm(obs: TensorDict, env: VecEnv, cfg: dict, device: str) -> PPO:
        """Build everything.

        Raises:
            ValueError: There is nothing to imitate; one line that names the setting.
        """
        if GROUP not in obs or len(Camera.of(env).actions) != 2:
            raise ValueError("runner.algorithm: GazePPO needs the group gaze, task.teach_gaze=true.")
        return PPO.construct_algorithm(obs, env, cfg, device)

    def act(self, obs: TensorDict) -> torch.Tensor:
        """Sample actions, and note where to look."""
        assert self.storage.targets is not None
        self.storage.targets[self.storage.step].copy_(obs[GROUP])
        return super().act(obs)

    def _extra_losses(self, batch: Batch) -> dict[str, tuple[float, torch.Tensor]]:
        assert batch.targets is not None
        says = batch.targets[..., 2]
        error = (self.actor.output_mean[..., -2:] - batch.targets[..., :2]).square().sum(-1)
        return {GROUP: (self.imitation_weight, (error * says).sum() / says.sum().clamp_min(1.0))}
