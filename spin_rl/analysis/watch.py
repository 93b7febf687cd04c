"""A policy under observation: what its camera has shown when, and the state at the end of its episodes."""

from __future__ import annotations

import numpy as np
import torch
import warp as wp
from tensordict import TensorDict

from spin_rl.analysis.hits import NearestObstacle
from spin_rl.policy import Policy
from spin_rl.tasks.nav.env import NavEnv
from spin_rl.warp_kernels.tokens import NUM_CORNERS, TOKEN_SIZE

SETTLING_S = 1.0
"""Episodes start with a random camera pose, which says nothing about the policy."""
NEVER = -1
"""Stands for the observation at which something was seen last."""


class Watch:
    """Passes a policy through and follows the first episode of every world after each full reset.

    Subclasses look at the episodes that end. What they find of them is of the last observation before: the
    step that ends an episode also begins the next one.
    """

    def __init__(self, policy: Policy, env: NavEnv) -> None:
        """Watch a policy in an environment that only it acts in."""
        self._policy = policy
        self._env = env
        self._nearest = NearestObstacle(env.sim)
        self._period = env.cfg.sim.control_period
        self._now = {
            "qpos": env.sim.views.qpos,
            "qvel": env.sim.views.qvel,
            "slot_pos": wp.to_torch(env.sim.layout.pos),
            "part_contacts": env.sim.views.part_contacts,
        }
        self._nearby = wp.to_torch(env.sim.layout.nearby)

    def __call__(self, obs: TensorDict) -> torch.Tensor:
        """Return the policy's actions, shape (num_envs, 10)."""
        self._observe(obs)
        return self._policy(obs)

    def reset(self, dones: torch.Tensor | None = None) -> None:
        """Clear the policy's state and close the episodes that ended; without a mask, begin new ones."""
        self._policy.reset(dones)
        if dones is None:
            self._begin()
            return
        ended = self._running & (dones > 0)
        self._running &= ~ended
        worlds = ended.nonzero().flatten()
        if len(worlds):
            self._end(worlds)

    def _begin(self) -> None:
        env = self._env
        self._running = torch.ones(env.num_envs, dtype=torch.bool, device=env.device)
        slots = env.sim.layout.pool.num_slots
        # Number of the observation, and of the one that showed a corner of a slot last.
        self._step = NEVER
        # The last column takes the tokens of no slot.
        self._seen_at = torch.full((env.num_envs, slots + 1), NEVER, dtype=torch.int32, device=env.device)
        self._last = {name: self._now[name].clone() for name in ("qpos", "qvel", "slot_pos")}
        self._nearest.remember_layouts()

    def _observe(self, obs: TensorDict) -> None:
        self._step += 1
        for name, values in self._last.items():
            values.copy_(self._now[name])
        tokens = obs["scandots"].view(self._env.num_envs, -1, TOKEN_SIZE)
        slots = self._nearby.long() % self._seen_at.shape[1]
        seen = (tokens[..., -NUM_CORNERS:] > 0.0).any(-1)
        self._seen_at.scatter_(1, slots, torch.where(seen, self._step, self._seen_at.gather(1, slots)))

    def _end(self, worlds: torch.Tensor) -> None:
        """Look at episodes that have just ended; world indices, shape (n,)."""
        raise NotImplementedError

    def _rows(self, worlds: torch.Tensor) -> dict[str, np.ndarray]:
        """Copy the worlds' last observed state and what touched in the last step to the host."""
        tensors = self._last | {"parts": self._now["part_contacts"], "seen_at": self._seen_at}
        return {name: values[worlds].cpu().numpy() for name, values in tensors.items()}
