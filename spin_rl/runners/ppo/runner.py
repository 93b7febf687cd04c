"""The training of phase 1: PPO."""

from __future__ import annotations

from typing import Any

from tensordict import TensorDict

from spin_rl.runners.config import check_config
from spin_rl.runners.loop import TrainingLoop
from spin_rl.runners.ppo.algorithm import PPO


class PPORunner(TrainingLoop):
    """Trains a policy by PPO; the sections of its configuration are `actor`, `critic` and `algorithm`."""

    alg: PPO

    def _check(self, cfg: dict[str, Any], obs: TensorDict, num_envs: int) -> None:
        check_config(cfg, list(map(str, obs.keys())), num_envs)

    def _scalars(self, losses: dict[str, float]) -> dict[str, float]:
        return {"Policy/mean_std": self.alg.actor.output_std.mean().item()}
