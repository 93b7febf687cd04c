"""Observation groups of the pick task, everything relative to the robot (SPIN 2.1.1).

    proprio       (num_envs, 31)  see PROPRIO in `proprioception.py`
    hand          (num_envs, 7)   x and z axis of the gripper in the base frame, and the grip: target of the
                                  fingers minus where they are [rad]
    object_start  (num_envs, 3)   o_i: where the object was at the start of the episode, in the base frame
                                  now [m]
    object        (num_envs, 10)  F(o_t): 1, where the object is now in the base frame [m], and from the grasp
                                  centre in the gripper's axes, in units of 0.2 m and of 0.05 m, clipped to
                                  [-1, 1]; all 0 while the camera does not see it
    object_at_start  (num_envs, 10)  object as if it was seen and where it was at the start: o_i
                                  in the gripper's axes by the robot's own kinematics, for students
    privileged    (num_envs, 40)  for the critic, see PRIVILEGED
    depth         (num_envs, rows * cols)  image, uint8, see `DepthImages.observe`; if enabled
    hand_in_image  (num_envs, 3)  where the grasp centre is in it, see `DepthImages.locate`; with the image

The gripper's axes are those of the grasp centre: x out of the gripper, y from finger to finger.
"""

from __future__ import annotations

import torch
import warp as wp
from tensordict import TensorDict

from spin_rl import robot
from spin_rl.scenes.objects.shapes import OBJECTS
from spin_rl.sim.simulation import Simulation
from spin_rl.tasks.common import formulas
from spin_rl.tasks.common.depth import DepthImages
from spin_rl.tasks.common.proprioception import Proprioception, joints
from spin_rl.tasks.pick.config import PickNoise

FORCE_N = 15.0
"""Unit of the forces that the critic reads [N]."""
# Blocks of the privileged group and their widths.
PRIVILEGED: dict[str, int] = {
    "forces": 4,  # left and right fingertip on the object, fingers on the scene, other parts [15 N]
    "support": 1,  # whether the object rests on something
    "kind": len(OBJECTS),  # one-hot
    "object": 3,  # o_t in the base frame [m]
    "offset": 3,  # from the grasp centre to the object, in the gripper's axes, in units of 0.2 m
    "orientation": 6,  # x and z axis of the object, in the gripper's axes
    "half_extents": 3,  # [0.1 m]
    "heights": 2,  # of the object over its start [0.1 m], of the table's top over the floor [m]
    "velocity": 3,  # of the object [m/s]
    "grip": len(robot.JOINTS),  # targets of the joints minus where they are [m, rad]
    "time": 2,  # part of the episode that is left, part of the time for which the object must be held
}


class PickObservations(Proprioception):
    """Computes the observation groups from simulator memory."""

    def __init__(
        self,
        sim: Simulation,
        noise: PickNoise,
        seed: int,
        *,
        seen: torch.Tensor,
        at: torch.Tensor,
        length: torch.Tensor,
        held: torch.Tensor,
        max_length: int,
        hold_steps: int,
        depth: DepthImages | None = None,
    ) -> None:
        """Prepare constants on the simulation's device.

        Args:
            sim: The simulation to read, with manipulation.
            noise: Sensor noise.
            seed: Seed of the noise.
            seen: Whether the camera sees the object, a view, shape (num_envs,), bool.
            at: Where it sees it, world, a view [m], shape (num_envs, 3).
            length: Steps of the running episodes, shape (num_envs,), int32.
            held: For how many of the last steps the object has been held up, shape (num_envs,), int32.
            max_length: Limit of the former.
            hold_steps: Steps for a success.
            depth: The depth camera, if the task has one.
        """
        super().__init__(sim, noise, seed)
        self._noise = noise
        self._depth = depth
        self._object, self._grasp = sim.object.views, sim.grasp.views
        self._seen, self._at = seen, at
        self._site_mat = wp.to_torch(sim.data.site_xmat)
        self._kinds = torch.arange(len(OBJECTS), dtype=torch.int32, device=sim.device)
        self._length, self._held = length, held
        self._max_length, self._hold_steps = max_length, hold_steps
        self._finger = robot.JOINTS.index("gripper_finger")
        self._start_error = torch.zeros(sim.nworld, 3, device=sim.device)

    def compute(self) -> TensorDict:
        """Return new tensors of all groups; noise is drawn anew at every call."""
        gripper = self._site_mat[:, self._eef]
        grip = self._views.target - joints(self._views.qpos)
        start = self._object.start_pose[:, :3] + self._start_errors()
        start = self.perturbed(start, self._noise.object_m)
        groups = {
            "proprio": self.proprio(),
            "hand": formulas.hand(gripper, self._views.qpos, grip[:, self._finger : self._finger + 1]),
            "object_start": formulas.in_base(start, self._views.qpos),
            "object": self._told(self.perturbed(self._at, self._noise.object_m), gripper)
            * self._seen[:, None],
            "object_at_start": self._told(start, gripper),
            "privileged": self._privileged(gripper, grip),
        }
        if self._depth is not None:
            groups["depth"] = self._depth.observe()
            groups["hand_in_image"] = self._depth.locate(self.grasp_centre)
        return TensorDict(groups, batch_size=[self._sim.nworld])

    @property
    def grasp_centre(self) -> torch.Tensor:
        """Between the fingertips, world, a view [m], shape (num_envs, 3)."""
        return self._views.site_pos[:, self._eef]

    def _start_errors(self) -> torch.Tensor:
        """Return what is wrong with o_i in this episode [m], world, shape (num_envs, 3)."""
        scale = self._noise.object_start_m
        if scale > 0.0:
            drawn = self.perturbed(torch.zeros_like(self._start_error), scale)
            self._start_error = torch.where((self._length == 0)[:, None], drawn, self._start_error)
        return self._start_error

    def _told(self, at: torch.Tensor, gripper: torch.Tensor) -> torch.Tensor:
        """Return what a policy is told of an object that is seen at world points, shape (num_envs, 10)."""
        return formulas.seen_object(at, self._views.qpos, self.grasp_centre, gripper)

    def _privileged(self, gripper: torch.Tensor, grip: torch.Tensor) -> torch.Tensor:
        """Return the blocks of PRIVILEGED, shape (num_envs, 40)."""
        thing, grasp = self._object, self._grasp
        bottom = thing.start_pose[:, 2] - thing.half_extents[:, 2]
        x_axis, z_axis = _axes(thing.quat)
        return torch.cat(
            (
                grasp.finger_force / FORCE_N,
                torch.stack((grasp.table_force, grasp.hard_contact), -1) / FORCE_N,
                grasp.object_support[:, None].float(),
                (thing.kind[:, None] == self._kinds).float(),
                formulas.in_base(thing.pos, self._views.qpos),
                formulas.NEAR_PER_M * formulas.turned_back(gripper, thing.pos - self.grasp_centre),
                formulas.turned_back(gripper, x_axis),
                formulas.turned_back(gripper, z_axis),
                thing.half_extents * 10.0,
                torch.stack(((thing.pos[:, 2] - thing.start_pose[:, 2]) * 10.0, bottom), -1),
                thing.velocity[:, :3],
                grip,
                torch.stack((1.0 - self._length / self._max_length, self._held / self._hold_steps), -1),
            ),
            -1,
        )


def _axes(quat: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the x and the z axis of orientations (w, x, y, z), shape (num_envs, 4)."""
    w, x, y, z = quat.unbind(-1)
    x_axis = torch.stack((1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)), -1)
    z_axis = torch.stack((2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)), -1)
    return x_axis, z_axis
