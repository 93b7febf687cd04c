"""A policy under observation: where its camera points, and what the robot hits without having seen it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict

from spin_rl import robot
from spin_rl.analysis.camera.examples import Recording, examples
from spin_rl.analysis.camera.motion import CameraMotion, camera_motion, share_of_time
from spin_rl.analysis.hits import FLOOR, Hit
from spin_rl.analysis.watch import NEVER, SETTLING_S, Watch
from spin_rl.policy import Policy
from spin_rl.tasks.common import episode
from spin_rl.tasks.nav.env import NavEnv

_CAMERA_DOFS = [robot.DOF_NAMES.index(joint) for joint in robot.CAMERA_JOINTS]


@dataclass(frozen=True)
class Motion:
    """How a camera moved.

    Attributes:
        pan: Over all episodes.
        tilt: Likewise.
        share: See `motion.share_of_time`.
        examples: See `examples.examples`, of the first batch.
    """

    pan: CameraMotion
    tilt: CameraMotion
    share: dict[str, Any]
    examples: list[dict[str, Any]]


class WatchedPolicy(Watch):
    """Records where the camera points and what the robot hits."""

    def __init__(self, policy: Policy, env: NavEnv) -> None:
        """Watch a policy in an environment that only it acts in."""
        super().__init__(policy, env)
        self._is_wall = env.sim.layout.is_wall.numpy()
        self._recorded: list[tuple[np.ndarray, np.ndarray]] = []
        self._steps: dict[str, list[torch.Tensor]] = {}
        self.hits: list[Hit] = []
        self.examples: list[dict[str, Any]] = []

    def _begin(self) -> None:
        self._store()
        super()._begin()
        self._steps = {"pose": [], "base": [], "fastest": [], "running": []}
        self._outcomes = torch.zeros_like(self._env.outcome)

    def _observe(self, obs: TensorDict) -> None:
        before = self._last["slot_pos"].clone()
        super()._observe(obs)
        moved = (self._last["slot_pos"] - before)[..., :2].norm(dim=-1).amax(-1)
        now = {
            "pose": self._last["qpos"][:, _CAMERA_DOFS],
            "base": self._last["qpos"][:, :3].clone(),
            "fastest": moved / self._period,
            "running": self._running.clone(),
        }
        for name, values in now.items():
            self._steps[name].append(values)

    def _end(self, worlds: torch.Tensor) -> None:
        self._outcomes[worlds] = self._env.outcome[worlds]
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
        """Keep what was recorded of a batch; single episodes of the first one."""
        if self._steps.get("running"):
            of = {name: torch.stack(values).cpu().numpy() for name, values in self._steps.items()}
            if not self.examples:
                ends = np.where(self._running.cpu().numpy(), 0, of["running"].sum(0))
                outcomes = self._outcomes.cpu().numpy()
                recording = Recording(of["pose"], of["base"], of["fastest"], ends, outcomes, self._period)
                self.examples = examples(recording)
            of["running"][: round(SETTLING_S / self._period)] = False
            self._recorded.append((of["pose"], of["running"]))
        self._steps = {}

    def motion(self) -> Motion | None:
        """Sum up how the camera moved in all episodes; None if none outlasted `SETTLING_S`."""
        self._store()
        steps = max(len(valid) for _, valid in self._recorded)
        poses = np.concatenate([_padded(poses, steps) for poses, _ in self._recorded], axis=1)
        valid = np.concatenate([_padded(valid, steps) for _, valid in self._recorded], axis=1)
        motions = [camera_motion(poses[..., i], valid, self._period) for i in range(len(robot.CAMERA_JOINTS))]
        if motions[0] is None or motions[1] is None:
            return None
        return Motion(motions[0], motions[1], share_of_time(poses[valid]), self.examples)


def _padded(values: np.ndarray, steps: int) -> np.ndarray:
    return np.concatenate([values, np.zeros((steps - len(values), *values.shape[1:]), values.dtype)])
