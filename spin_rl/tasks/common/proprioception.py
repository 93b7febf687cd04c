"""What the robot feels of itself: the observation group `proprio`, the same in all tasks (SPIN, x_t)."""

from __future__ import annotations

import torch

from spin_rl import robot
from spin_rl.sim.simulation import Simulation
from spin_rl.tasks.common import formulas
from spin_rl.tasks.common.config import ProprioNoise

# Blocks of the proprio group and their widths.
PROPRIO: dict[str, int] = {
    "joint_position": len(robot.JOINTS),  # 0 at the middle of each joint's range, -1 and 1 at its limits
    "joint_velocity": len(robot.JOINTS),  # divided by the joint's speed limit
    "base_velocity": 2,  # forward [m/s], turning [rad/s], measured
    "end_effector": 3,  # grasp centre in the base frame [m]
    "last_action": len(robot.ACTIONS),
}
CAMERA_ACTIONS = tuple(robot.ACTIONS.index(joint) for joint in robot.CAMERA_JOINTS)


def proprio_columns() -> dict[str, int]:
    """Return the column of every number of the proprio group, such as `joint_position/head_pan`."""
    parts = {
        "joint_position": robot.JOINTS,
        "joint_velocity": robot.JOINTS,
        "base_velocity": ("forward", "turn"),
        "end_effector": ("x", "y", "z"),
        "last_action": robot.ACTIONS,
    }
    names = [f"{block}/{part}" for block in PROPRIO for part in parts[block]]
    return {name: column for column, name in enumerate(names)}


def camera_columns() -> dict[str, tuple[int, ...]]:
    """Return the columns of each group that tell where the camera is, how it moves and what moved it last."""
    blocks, columns = ("joint_position", "joint_velocity", "last_action"), proprio_columns()
    return {
        "proprio": tuple(columns[f"{block}/{joint}"] for block in blocks for joint in robot.CAMERA_JOINTS)
    }


class Proprioception:
    """The proprio group from simulator memory, and the noise generator of a task's observations."""

    def __init__(self, sim: Simulation, noise: ProprioNoise, seed: int) -> None:
        """Prepare constants on the simulation's device.

        Args:
            sim: The simulation to read.
            noise: Sensor noise.
            seed: Seed of the noise.
        """
        self._sim = sim
        self._views = sim.views
        self._proprio_noise = noise
        device = torch.device(sim.device)
        self._rng = torch.Generator(device=device).manual_seed(seed)
        self._eef = sim.mj_model.site("link_grasp_center").id

    def proprio(self) -> torch.Tensor:
        """Return the group, blocks as in PROPRIO, shape (num_envs, 31); noise is drawn anew at every call."""
        noise = self._proprio_noise
        qpos, qvel = self._views.qpos, self._views.qvel
        yaw = qpos[:, 2:3]
        base_velocity = torch.cat((qvel[:, :1] * yaw.cos() + qvel[:, 1:2] * yaw.sin(), qvel[:, 2:3]), -1)
        return formulas.proprio(
            self.perturbed(formulas.joint_position(joints(qpos)), noise.joint_position),
            self.perturbed(formulas.joint_velocity(joints(qvel)), noise.joint_velocity),
            self.perturbed(base_velocity, noise.base_velocity),
            formulas.in_base(self._views.site_pos[:, self._eef], qpos),
            self._views.action,
        )

    def perturbed(self, value: torch.Tensor, scale: float) -> torch.Tensor:
        """Add normal noise of a standard deviation; 0 draws nothing and returns the same tensor."""
        if scale == 0.0:
            return value
        return value + scale * torch.randn(value.shape, generator=self._rng, device=value.device)

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


def joints(values: torch.Tensor) -> torch.Tensor:
    """Read `robot.JOINTS` values out of generalized ones, (num_envs, 13 or more) -> (num_envs, 8)."""
    arm = values[:, 4:5] + values[:, 5:6]
    finger = 0.5 * (values[:, 9:10] + values[:, 10:11])
    return torch.cat((values[:, 3:4], arm, values[:, 6:9], finger, values[:, 11:13]), -1)
