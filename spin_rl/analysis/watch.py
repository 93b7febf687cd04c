"""A policy under observation: where its camera points, and what the robot hits without having seen it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
import warp as wp
from tensordict import TensorDict

from spin_rl import robot
from spin_rl.analysis.hits import FLOOR, Hit, NearestObstacle
from spin_rl.policy import Policy
from spin_rl.tasks.common import episode
from spin_rl.tasks.nav.env import NavEnv
from spin_rl.warp_kernels.tokens import NUM_CORNERS, TOKEN_SIZE

_CAMERA_DOFS = [robot.DOF_NAMES.index(joint) for joint in robot.CAMERA_JOINTS]
# Episodes start with a random camera pose, which says nothing about the policy.
SETTLING_S = 1.0


@dataclass(frozen=True)
class CameraMotion:
    """Statistics of one camera joint over the observations of episodes, after `SETTLING_S`.

    Attributes:
        mean: Over all observations [rad].
        std: Over all observations [rad].
        p5: 5th percentile [rad].
        p95: 95th percentile [rad].
        std_within: Mean of the episodes' own standard deviations [rad]: 0 for a constant pose, even where it
            differs between episodes.
        rate: Mean absolute rate of change [rad/s].
    """

    mean: float
    std: float
    p5: float
    p95: float
    std_within: float
    rate: float


def camera_motion(poses: np.ndarray, valid: np.ndarray, period: float) -> CameraMotion | None:
    """Sum up the recorded positions of a joint.

    Args:
        poses: Positions [rad], shape (steps, episodes).
        valid: Which of them count, shape (steps, episodes), bool.
        period: Time between two steps [s].

    Returns:
        The statistics, or None if nothing counts.
    """
    if not valid.any():
        return None
    values = poses[valid].astype(np.float64)
    pairs = valid[1:] & valid[:-1]
    change = np.abs(np.diff(poses, axis=0))[pairs]
    within = [
        poses[rows, i].astype(np.float64).std() for i, rows in enumerate(valid.T) if np.count_nonzero(rows)
    ]
    return CameraMotion(
        mean=float(values.mean()),
        std=float(values.std()),
        p5=float(np.percentile(values, 5)),
        p95=float(np.percentile(values, 95)),
        std_within=float(np.mean(within)),
        rate=float(change.mean()) / period if change.size else 0.0,
    )


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


class WatchedPolicy(Watch):
    """Records where the camera points and what the robot hits."""

    def __init__(self, policy: Policy, env: NavEnv) -> None:
        """Watch a policy in an environment that only it acts in."""
        super().__init__(policy, env)
        self._is_wall = env.sim.layout.is_wall.numpy()
        self._recorded: list[tuple[np.ndarray, np.ndarray]] = []
        self._poses: list[torch.Tensor] = []
        self._valid: list[torch.Tensor] = []
        self.hits: list[Hit] = []

    def _begin(self) -> None:
        self._store()
        super()._begin()

    def _observe(self, obs: TensorDict) -> None:
        super()._observe(obs)
        self._poses.append(self._last["qpos"][:, _CAMERA_DOFS])
        self._valid.append(self._running.clone())

    def _end(self, worlds: torch.Tensor) -> None:
        worlds = worlds[self._env.outcome[worlds] == episode.COLLISION]
        rows = self._rows(worlds)
        for i, world in enumerate(worlds.tolist()):
            touch = self._nearest.find(world, rows["slot_pos"][i], rows["qpos"][i], rows["parts"][i])[0]
            if touch.slot == FLOOR:
                self.hits.append(Hit("floor", seen=False))
            else:
                kind = "wall" if self._is_wall[touch.slot] else "obstacle"
                self.hits.append(Hit(kind, bool(rows["seen_at"][i, touch.slot] != NEVER)))

    def _store(self) -> None:
        if self._poses:
            valid = torch.stack(self._valid).cpu().numpy()
            valid[: round(SETTLING_S / self._period)] = False
            self._recorded.append((torch.stack(self._poses).cpu().numpy(), valid))
        self._poses, self._valid = [], []

    def camera(self) -> dict[str, CameraMotion] | None:
        """Return pan's and tilt's statistics over all episodes, None if none outlasted `SETTLING_S`."""
        self._store()
        steps = max(len(valid) for _, valid in self._recorded)
        poses = np.concatenate([_padded(poses, steps) for poses, _ in self._recorded], axis=1)
        valid = np.concatenate([_padded(valid, steps) for _, valid in self._recorded], axis=1)
        motions = [camera_motion(poses[..., i], valid, self._period) for i in range(len(robot.CAMERA_JOINTS))]
        if motions[0] is None or motions[1] is None:
            return None
        return {"pan": motions[0], "tilt": motions[1]}


def _padded(values: np.ndarray, steps: int) -> np.ndarray:
    return np.concatenate([values, np.zeros((steps - len(values), *values.shape[1:]), values.dtype)])
