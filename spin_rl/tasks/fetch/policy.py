"""One policy out of two: navigation for driving, picking for grasping."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from tensordict import TensorDict

from spin_rl import robot
from spin_rl.policy import Policy
from spin_rl.tasks.common import formulas
from spin_rl.tasks.common.proprioception import camera_columns
from spin_rl.tasks.fetch.config import STAGES


class FetchPolicy:
    """Picks every world's action by its stage; a policy's memory is empty when its stage begins.

    Scripted stages ignore the action.
    """

    def __init__(self, nav: Policy, pick: Policy, told_pose: Sequence[float] | None = None) -> None:
        """Keep the two policies; both are evaluated in all worlds.

        Args:
            nav: The one that drives.
            pick: The one that grasps.
            told_pose: Pan and tilt of the camera [rad] that `nav` is told of, wherever it is: one that sees
                nothing has known it in no other pose.
        """
        self._nav, self._pick = nav, pick
        self._told: tuple[torch.Tensor, torch.Tensor] | None = None
        if told_pose is not None:
            self._told = torch.tensor(camera_columns()["proprio"]), _told_values(told_pose)
        self._stage: torch.Tensor | None = None

    def __call__(self, obs: TensorDict) -> torch.Tensor:
        """Return actions for observations of `FetchEnv`, shape (num_envs, 10)."""
        stage = obs["stage"][:, 0]
        if self._stage is not None:
            entered = stage != self._stage
            self._nav.reset(entered)
            self._pick.reset(entered)
        self._stage = stage
        picks = stage == STAGES.index("pick")
        return torch.where(picks[:, None], self._pick(obs), self._nav(self._for_nav(obs)))

    def _for_nav(self, obs: TensorDict) -> TensorDict:
        if self._told is None:
            return obs
        obs, proprio = obs.copy(), obs["proprio"]
        columns, values = self._told = self._told[0].to(proprio.device), self._told[1].to(proprio)  # once
        obs["proprio"] = proprio.index_copy(-1, columns, values.expand(len(proprio), -1))
        return obs

    def reset(self, dones: torch.Tensor | None = None) -> None:
        """Clear the memory of the worlds in a mask (num_envs,), or of all."""
        self._nav.reset(dones)
        self._pick.reset(dones)
        if dones is None:
            self._stage = None


def _told_values(pose: Sequence[float]) -> torch.Tensor:
    """What proprioception tells of a camera that stands at a pose, as its columns are, shape (6,)."""
    joints = torch.tensor([[robot.STOWED[joint] for joint in robot.JOINTS[:-2]] + list(pose)])
    actions = [robot.action_of(joint, at) for joint, at in zip(robot.CAMERA_JOINTS, pose, strict=True)]
    return torch.cat((formulas.joint_position(joints)[0, -2:], torch.zeros(2), torch.tensor(actions)))
