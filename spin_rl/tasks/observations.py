"""Observation groups of the navigation task, everything relative to the robot (SPIN, Observation Space).

    proprio       (num_envs, 31)  see PROPRIO
    goal          (num_envs, 3)   goal in the base frame: x, y and distance [m], divided by GOAL_SCALE_M
    scandots      (num_envs, slots * 32)  tokens of what the camera sees, F(s_t, x_t)
    scandots_all  (num_envs, slots * 32)  tokens of the whole local window, s_t
    depth         (num_envs, rows * cols) image d_t, uint8, see `DepthImages.observe`; if enabled

A token is 8 bounding-box corners (x, y, z) in the base frame [m] and 8 validity flags.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
import warp as wp
from tensordict import TensorDict

from spin_rl import robot
from spin_rl.sensors.scandots import Scandots
from spin_rl.sim.simulation import Simulation
from spin_rl.tasks.depth import DepthImages

GROUPS = ("proprio", "goal", "scandots", "scandots_all")
OPTIONAL_GROUPS = ("depth",)
GOAL_SCALE_M = 2.5
# Blocks of the proprio group and their widths.
PROPRIO: dict[str, int] = {
    "joint_position": len(robot.JOINTS),  # 0 at the middle of each joint's range, -1 and 1 at its limits
    "joint_velocity": len(robot.JOINTS),  # divided by the joint's speed limit
    "base_velocity": 2,  # forward [m/s], turning [rad/s], measured
    "end_effector": 3,  # grasp centre in the base frame [m]
    "last_action": len(robot.ACTIONS),
}
CAMERA_JOINTS = ("head_pan", "head_tilt")
CAMERA_ACTIONS = tuple(robot.ACTIONS.index(joint) for joint in CAMERA_JOINTS)


def camera_columns() -> dict[str, tuple[int, ...]]:
    """Return the columns of each group that tell where the camera is, how it moves and what moved it last."""
    columns, offset = [], 0
    for block, width in PROPRIO.items():
        names = {"joint_position": robot.JOINTS, "joint_velocity": robot.JOINTS, "last_action": robot.ACTIONS}
        columns += [offset + names[block].index(joint) for joint in CAMERA_JOINTS if block in names]
        offset += width
    return {"proprio": tuple(columns)}


@dataclass(frozen=True)
class NoiseConfig:
    """Sensor noise in training, standard deviations of zero-mean normal (scandots: uniform) noise.

    Attributes:
        joint_position: In units of the normalized position.
        joint_velocity: In units of the normalized velocity.
        base_velocity: [m/s, rad/s].
        goal_m: Of the goal's x and y [m].
        scandots_m: Half width of the uniform noise on every scandot coordinate [m].
    """

    joint_position: float = 0.0
    joint_velocity: float = 0.0
    base_velocity: float = 0.0
    goal_m: float = 0.0
    scandots_m: float = 0.0

    def __post_init__(self) -> None:
        """Reject negative noise."""
        for name, value in vars(self).items():
            if not 0.0 <= value < math.inf:
                raise ValueError(f"task.noise.{name} must not be negative, got {value}")


class NavObservations:
    """Computes the observation groups from simulator memory."""

    def __init__(
        self,
        sim: Simulation,
        scandots: Scandots,
        noise: NoiseConfig,
        seed: int,
        depth: DepthImages | None = None,
    ) -> None:
        """Prepare constants on the simulation's device.

        Args:
            sim: The simulation to read.
            scandots: Its scandot sensor.
            noise: Sensor noise.
            seed: Seed of the noise.
            depth: Its depth camera, if it has one.
        """
        self._sim = sim
        self._depth = depth
        self._views = sim.views
        self._scandots = scandots
        self._noise = noise
        device = torch.device(sim.device)
        self._rng = torch.Generator(device=device).manual_seed(seed)
        lower = torch.tensor(robot.JOINT_LOWER, device=device)
        upper = torch.tensor(robot.JOINT_UPPER, device=device)
        self._middle = (lower + upper) / 2
        self._half_range = (upper - lower) / 2
        # Normalized by the fastest profile, so that policies of both profiles read the same units.
        self._max_speed = torch.tensor(robot.SPEED_PROFILES["paper"].joint_velocity_max, device=device)
        self._eef = sim.mj_model.site("link_grasp_center").id
        self._visible = wp.to_torch(scandots.visible).flatten(1)
        self._all = wp.to_torch(scandots.all).flatten(1)

    def compute(self) -> TensorDict:
        """Return new tensors of all groups; noise is drawn anew at every call."""
        proprio = self._proprio()
        goal_b = self._goal_in_base()
        groups = {
            "proprio": proprio,
            "goal": torch.cat((goal_b, goal_b.norm(dim=-1, keepdim=True)), -1) / GOAL_SCALE_M,
            "scandots": self._with_noise(self._visible),
            "scandots_all": self._all.clone(),
        }
        if self._depth is not None:
            groups["depth"] = self._depth.observe()
        return TensorDict(groups, batch_size=[self._sim.nworld])

    def _proprio(self) -> torch.Tensor:
        noise = self._noise
        qpos, qvel = self._views.qpos, self._views.qvel
        position = (_joints(qpos) - self._middle) / self._half_range
        velocity = _joints(qvel) / self._max_speed
        yaw = qpos[:, 2:3]
        base_velocity = torch.cat((qvel[:, :1] * yaw.cos() + qvel[:, 1:2] * yaw.sin(), qvel[:, 2:3]), -1)
        eef_w = self._views.site_pos[:, self._eef]
        eef_xy = _rotate(eef_w[:, :2] - qpos[:, :2], yaw)
        return torch.cat(
            (
                self._perturbed(position, noise.joint_position),
                self._perturbed(velocity, noise.joint_velocity),
                self._perturbed(base_velocity, noise.base_velocity),
                eef_xy,
                eef_w[:, 2:3],
                self._views.action,
            ),
            -1,
        )

    def _goal_in_base(self) -> torch.Tensor:
        qpos = self._views.qpos
        return self._perturbed(_rotate(self._views.goal - qpos[:, :2], qpos[:, 2:3]), self._noise.goal_m)

    def _perturbed(self, value: torch.Tensor, scale: float) -> torch.Tensor:
        if scale == 0.0:
            return value
        return value + scale * torch.randn(value.shape, generator=self._rng, device=value.device)

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

    def reseed(self, seed: int) -> None:
        """Restart the noise generator."""
        self._rng.manual_seed(seed)

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Return the state of the noise generator."""
        return {"noise_rng": self._rng.get_state()}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore the noise generator; one saved on another kind of device has no meaning here."""
        saved = state["noise_rng"].cpu()
        if saved.shape == self._rng.get_state().shape:
            self._rng.set_state(saved)


def _joints(values: torch.Tensor) -> torch.Tensor:
    """Read `robot.JOINTS` values out of generalized ones, (num_envs, 13) -> (num_envs, 8)."""
    arm = values[:, 4:5] + values[:, 5:6]
    finger = 0.5 * (values[:, 9:10] + values[:, 10:11])
    return torch.cat((values[:, 3:4], arm, values[:, 6:9], finger, values[:, 11:13]), -1)


def _rotate(vector_w: torch.Tensor, yaw: torch.Tensor) -> torch.Tensor:
    """Turn world vectors (num_envs, 2) into the base frame."""
    x, y = vector_w[:, :1], vector_w[:, 1:2]
    cos, sin = yaw.cos(), yaw.sin()
    return torch.cat((cos * x + sin * y, cos * y - sin * x), -1)
