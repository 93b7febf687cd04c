"""PPO whose camera imitates a gaze and follows it meanwhile; the base learns to drive by what that shows."""

from __future__ import annotations

from typing import Any

import torch
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from spin_rl.ranges import Weight
from spin_rl.runners.interface import Camera
from spin_rl.runners.ppo.algorithm import PPO
from spin_rl.runners.ppo.storage import Batch

GROUP = "gaze"
"""Observation group with the camera actions to imitate, and with 1 where there are some."""


class GazePPO(PPO):
    """PPO with a supervised loss on the camera's mean actions, which count in nothing else.

    The loss is the mean squared error to the group `gaze` where that says something. In training the camera
    goes there whatever the policy says (`task.teach_gaze`), so the policy sees what it will see once it has
    learned that. Its own camera would keep it from learning: one that is sent half the way between two poses
    gets to neither, and never shows what to do next. No model reads the group, since it may tell of things
    that the camera has not shown. The camera's actions are the environment's last ones.
    """

    def __init__(self, *args: Any, gaze_loss: Weight = 5.0, **settings: Any) -> None:
        """Initialize as PPO.

        Args:
            args: As of PPO.
            gaze_loss: Weight of the supervised loss.
            settings: As of PPO.
        """
        super().__init__(*args, **settings)
        self.gaze_loss = gaze_loss
        self.storage.targets = self.storage.actions.new_zeros(*self.storage.dones.shape, 3)

    @staticmethod
    def construct_algorithm(obs: TensorDict, env: VecEnv, cfg: dict, device: str) -> PPO:
        """Build everything.

        Raises:
            ValueError: There is nothing to imitate, or the camera's actions count as the policy's; one line
                that names the setting.
        """
        if GROUP not in obs or len(Camera.of(env).actions) != 2:
            raise ValueError("runner.algorithm: GazePPO needs the group gaze, task.teach_gaze=true.")
        others = env.num_actions - 2
        if cfg["actor"]["distribution_cfg"].get("num_used") != others:
            raise ValueError(
                f"runner.actor.distribution_cfg.num_used: GazePPO needs {others}, all but the camera's."
            )
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
        return {GROUP: (self.gaze_loss, (error * says).sum() / says.sum().clamp_min(1.0))}
