"""Observation groups of the navigation task, everything relative to the robot (SPIN, Observation Space).

    proprio       (num_envs, 31)  see PROPRIO in `proprioception.py`
    goal          (num_envs, 3)   goal in the base frame: x, y and distance [m], divided by 2.5
    scandots      (num_envs, slots * 32)  tokens of what the camera sees, F(s_t, x_t)
    scandots_all  (num_envs, slots * 32)  tokens of the whole local window, s_t
    scandots_map  (num_envs, slots * 32)  the same read from a noisy map; if enabled
    way           (num_envs, 3)   length of the way to the goal [m], divided by 2.5, and its direction in the
                  base frame: what only a map tells, for critics
    lidar         (num_envs, rays)  ranges of the rays swept in the last step [m], see `Lidar`; if enabled
    odometry      (num_envs, 3)   x, y [m] and yaw [rad] in the frame of the start, with errors; if enabled
    gaze          (num_envs, 3)   camera actions to imitate and 1, or zeros, see `Gaze`; if enabled
    depth         (num_envs, rows * cols) image d_t, uint8, see `DepthImages.observe`; if enabled

A token is 8 bounding-box corners (x, y, z) in the base frame [m] and 8 validity flags.
"""

from __future__ import annotations

import torch
import warp as wp
from tensordict import TensorDict

from spin_rl.sensors.noisy_map import NoisyMap
from spin_rl.sensors.scandots import Scandots
from spin_rl.sim.simulation import Simulation
from spin_rl.tasks.common import formulas
from spin_rl.tasks.common.depth import DepthImages
from spin_rl.tasks.common.proprioception import Proprioception
from spin_rl.tasks.nav.config import NavNoise
from spin_rl.tasks.nav.ways import WayAhead


class NavObservations(Proprioception):
    """Computes the observation groups from simulator memory."""

    def __init__(
        self,
        sim: Simulation,
        goal: torch.Tensor,
        scandots: Scandots,
        noise: NavNoise,
        seed: int,
        depth: DepthImages | None = None,
        goal_range: float | None = None,
        ahead: WayAhead | None = None,
        noisy_map: NoisyMap | None = None,
    ) -> None:
        """Prepare constants on the simulation's device.

        Args:
            sim: The simulation to read.
            goal: Where the base should go, world, a view [m], shape (num_envs, 2).
            scandots: Its scandot sensor.
            noise: Sensor noise.
            seed: Seed of the noise.
            depth: Its depth camera, if it has one.
            goal_range: Farthest that a goal is shown [m]; None shows it where it is.
            ahead: What a map would tell of the way, for the group `way`; None leaves it out.
            noisy_map: Obstacles as a map has them, for the group `scandots_map`; None leaves it out.
        """
        super().__init__(sim, noise, seed)
        self._goal = goal
        self._noise = noise
        self._depth = depth
        self._goal_range = goal_range
        self._ahead = None if ahead is None else ahead.values
        self._way_scale = goal.new_tensor((1.0 / formulas.GOAL_SCALE_M, 1.0, 1.0))
        self._visible = wp.to_torch(scandots.visible).flatten(1)
        self._all = wp.to_torch(scandots.all).flatten(1)
        self._map = None if noisy_map is None else wp.to_torch(noisy_map.tokens).flatten(1)
        self._further: dict[str, torch.Tensor] = {}

    def add(self, **groups: wp.array) -> None:
        """Add groups of what sensors measure, each of shape (num_envs, dim)."""
        self._further |= {name: wp.to_torch(measured) for name, measured in groups.items()}

    def compute(self) -> TensorDict:
        """Return new tensors of all groups; noise is drawn anew at every call."""
        proprio = self.proprio()
        goal_b = self.perturbed(formulas.in_base(self._goal, self._views.qpos), self._noise.goal_m)
        groups = {
            "proprio": proprio,
            "goal": formulas.goal(goal_b, self._goal_range),
            "scandots": self._with_noise(self._visible),
            "scandots_all": self._all.clone(),
        }
        if self._ahead is not None:
            groups["way"] = self._ahead * self._way_scale
        groups |= {name: measured.clone() for name, measured in self._further.items()}
        if self._map is not None:
            groups["scandots_map"] = self._map.clone()
        if self._depth is not None:
            groups["depth"] = self._depth.observe()
        return TensorDict(groups, batch_size=[self._sim.nworld])

    def _with_noise(self, tokens: torch.Tensor) -> torch.Tensor:
        if self._noise.scandots_m == 0.0:
            return tokens.clone()
        noise = torch.rand(tokens.shape, generator=self._rng, device=tokens.device)
        noise = noise.sub_(0.5).mul_(2.0 * self._noise.scandots_m)
        # Only valid corners move: coordinates of the others, and all flags, are left as they are.
        n = tokens.shape[0]
        by_token = tokens.view(n, -1, 32)
        offset = noise.view(n, -1, 32)[..., :24].view(n, -1, 8, 3) * by_token[..., 24:, None]
        result = by_token.clone()
        result[..., :24] += offset.view(n, -1, 24)
        return result.view(n, -1)
