"""Who drives where the camera does not matter: a policy that is shown everything, or a map's way."""

from __future__ import annotations

import numpy as np
import torch
import warp as wp
from tensordict import TensorDict

from spin_rl import robot
from spin_rl.planning.distance_field import DistanceField, GridSpec
from spin_rl.policy import Policy
from spin_rl.tasks.nav.env import NavEnv
from spin_rl.warp_kernels.slots import slots_of

_AHEAD_M = 0.4
"""Distance of the point on the way that it steers for."""

_ROOM_M = 0.45
"""Distance to walls from which a way costs no more than its length: it keeps to the middle of corridors."""

_GAIN = 2.5
"""Turning speed per angle to that point [1/s]."""

_TURNS_FIRST_RAD = 0.6
"""Angle to that point from which it turns on the spot."""


class SeesAll:
    """A policy of scandots that is told of all obstacles nearby, seen or not."""

    def __init__(self, policy: Policy) -> None:
        """Show everything to a policy."""
        self._policy = policy

    def __call__(self, obs: TensorDict) -> torch.Tensor:
        """Return the policy's actions, shape (num_envs, 10)."""
        shown = obs.copy()
        shown["scandots"] = obs["scandots_all"]
        return self._policy(shown)

    def reset(self, dones: torch.Tensor | None = None) -> None:
        """Clear the policy's state."""
        self._policy.reset(dones)


class MapDriver:
    """Follows the shortest way among the walls, the arm stowed, as if nothing else were there.

    Where it has two goals it reverses to the second one. It is meant for environments that no touch stops.
    """

    def __init__(self, env: NavEnv, speed_m_s: float) -> None:
        """Drive in an environment at a speed [m/s], where the robot can."""
        self._env = env
        self._speed = speed_m_s
        self._profile = robot.SPEED_PROFILES[env.cfg.robot_profile]

    def reset(self, dones: torch.Tensor | None = None) -> None:
        """Find the ways of all worlds where no mask is given; only first episodes are driven."""
        if dones is not None:
            return
        layout, device = self._env.sim.layout, self._env.device
        walls = slots_of(layout)
        active = wp.to_torch(layout.active) & wp.to_torch(layout.is_wall)
        walls.active = wp.from_torch(active)
        scenes = layout.scenes()
        field = DistanceField(walls, device, GridSpec.around(scenes), clearance_m=_ROOM_M)
        everywhere = wp.full(layout.nworld, True, dtype=bool, device=device)
        field.update(layout.goal, everywhere)
        field.trace(layout.start, everywhere)
        ways = [field.path(world) for world in range(layout.nworld)]
        longest = max(len(way) for way in ways)
        # All as long as the longest: goals stand for what is missing.
        self._ways = np.stack(
            [
                np.vstack([way, np.tile(scene.goal, (longest - len(way), 1))])
                for way, scene in zip(ways, scenes, strict=True)
            ]
        )
        self._reverses = np.array([scene.has_via for scene in scenes])
        self._reached = np.zeros(layout.nworld, dtype=int)

    def __call__(self, obs: TensorDict) -> torch.Tensor:
        """Return actions, shape (num_envs, 10): stowed, along the ways."""
        pose = self._env.sim.views.qpos[:, :3].cpu().numpy()
        target = np.where(self._reverses[:, None], self._env.goal.cpu().numpy(), self._next_points(pose))
        offset = target - pose[:, :2]
        angle = np.arctan2(offset[:, 1], offset[:, 0]) - pose[:, 2]
        angle = np.angle(np.exp(1j * angle))
        backward = self._reverses & (np.abs(angle) > 0.5 * np.pi)
        angle = np.where(backward, np.angle(-np.exp(1j * angle)), angle)
        speed = self._speed * np.clip(1.0 - np.abs(angle) / _TURNS_FIRST_RAD, 0.0, 1.0)
        forward = np.where(backward, -speed / self._profile.reverse_max, speed / self._profile.forward_max)
        actions = torch.zeros(len(pose), len(robot.ACTIONS))
        actions[:, 0] = torch.from_numpy(forward.clip(-1.0, 1.0))
        actions[:, 1] = torch.from_numpy((_GAIN * angle / self._profile.turn_max).clip(-1.0, 1.0))
        return actions.to(self._env.device)

    def _next_points(self, pose: np.ndarray) -> np.ndarray:
        """The first points of the ways, from those reached before on, that are not near, shape (n, 2)."""
        away = np.linalg.norm(self._ways - pose[:, None, :2], axis=-1)
        later = np.arange(self._ways.shape[1]) >= self._reached[:, None]
        far = (away > _AHEAD_M) & later
        self._reached = np.where(far.any(axis=1), far.argmax(axis=1), self._ways.shape[1] - 1)
        return self._ways[np.arange(len(pose)), self._reached]
