"""The navigation task as a gymnasium vector environment.

Importing this module registers it: `gymnasium.make_vec("spin_rl/Nav-v0", num_envs=64)`.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from spin_rl.tasks.common import episode
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.env import NavEnv
from spin_rl.tasks.nav.spec import NAV

ENV_ID = "spin_rl/Nav-v0"


class NavVectorEnv(VectorEnv):
    """Gymnasium's view of `NavEnv`: NumPy arrays in and out, worlds that end are reset in the same step.

    Observations are a dict of the groups in `nav/observations.py`. With same-step autoreset the observation
    of a step that ended an episode is the first of the next one; rewards, flags and `info["outcome"]` (see
    `episode.OUTCOMES`) are those of the step. Unlike gymnasium's own vector environments there is no
    `info["final_obs"]`: the last observation of an episode is overwritten on the device.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": []}  # noqa: RUF012

    def __init__(
        self, num_envs: int = 1, cfg: NavConfig | None = None, device: str = "cpu", seed: int = 0
    ) -> None:
        """Create the worlds.

        Args:
            num_envs: Number of worlds.
            cfg: Task configuration, that of `spin-train` by default.
            device: Warp and Torch device.
            seed: Seed of layouts, start poses, dynamics and noise.
        """
        self.env = NavEnv(cfg or NAV.as_trained(), num_envs, device, seed)
        self.num_envs = num_envs
        groups = self.env.get_observations()
        self.single_observation_space = gym.spaces.Dict(
            {
                name: gym.spaces.Box(-np.inf, np.inf, (value.shape[1],), np.float32)
                for name, value in groups.items()
            }
        )
        self.single_action_space = gym.spaces.Box(-1.0, 1.0, (self.env.num_actions,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Start a new episode in every world; a seed restarts the random numbers of layouts and starts."""
        super().reset(seed=seed)
        if seed is not None:
            self.env.reseed(seed)
        return self._numpy(self.env.reset()), {}

    def step(
        self, actions: np.ndarray
    ) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Apply actions of shape (num_envs, 10) for one control period of 0.1 s."""
        tensor = torch.as_tensor(np.asarray(actions, np.float32), device=self.env.device)
        obs, reward, done, extras = self.env.step(tensor)
        truncated = extras["time_outs"].cpu().numpy().copy()
        terminated = done.bool().cpu().numpy() & ~truncated
        info = {"outcome": self.env.outcome.cpu().numpy().copy()}
        return self._numpy(obs), reward.cpu().numpy(), terminated, truncated, info

    @staticmethod
    def outcome_name(outcome: int) -> str:
        """Return the name of an entry of `info["outcome"]`."""
        return episode.OUTCOMES[outcome]

    @staticmethod
    def _numpy(obs: Any) -> dict[str, np.ndarray]:
        return {name: value.cpu().numpy() for name, value in obs.items()}


def register() -> None:
    """Register the environment with gymnasium; importing `spin_rl.tasks.gym_env` does it."""
    if ENV_ID not in gym.registry:
        gym.register(ENV_ID, vector_entry_point="spin_rl.tasks.gym_env:NavVectorEnv")


register()
