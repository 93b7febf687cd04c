"""Running a policy to look at it: every step of every world as plain NumPy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from spin_rl.policy import Policy
from spin_rl.tasks.common.env import TaskEnv
from spin_rl.viewer.reader import OBJECT, ROBOT, SnapshotReader
from spin_rl.viewer.snapshot import Snapshot, Target


class Player:
    """An environment and a policy in it, one control step after the other.

    Attributes:
        env: The environment.
        title: What plays.
        ended: Last snapshots of all finished episodes since `start`, in the order of their end.
    """

    def __init__(self, env: TaskEnv, policy: Policy, title: str = "") -> None:
        """Take over an environment; `start` begins the first episodes.

        Args:
            env: Environment with any number of worlds.
            policy: Policy for it.
            title: What plays, such as the policy's name.
        """
        self.env = env
        self.title = title
        self.ended: list[Snapshot] = []
        self._policy = policy
        self._snapshots: list[Snapshot] = []
        self._set_cells = getattr(env, "set_cells", None)
        self._reader = SnapshotReader(env)

    @property
    def snapshots(self) -> list[Snapshot]:
        """Where every world is now; a world whose episode has ended is already at the start of its next."""
        return self._snapshots

    def start(
        self, scenario: int, difficulty: int, *, seed: int | None = None, policy: Policy | None = None
    ) -> list[Snapshot]:
        """Begin new episodes in all worlds.

        Args:
            scenario: 1 straight, 2 L-shaped, 0 a mix; of no meaning where the task has no corridors.
            difficulty: 0 easy, 1 medium, 2 hard, -1 a mix; likewise.
            seed: Starts the sequence of episodes of this seed; None goes on with the running sequence.
            policy: Another policy for the same environment; None keeps the present one.

        Returns:
            A snapshot of every world.
        """
        n = self.env.num_envs
        self._policy = policy or self._policy
        if self._set_cells is not None:
            self._set_cells([scenario] * n, [difficulty] * n)
        if seed is not None:
            self.env.reseed(seed)
        self._obs = self.env.reset()
        self._policy.reset()
        self.ended = []
        self._reader.restart()
        self._snapshots = self._reader.read()
        return self._snapshots

    @torch.no_grad()
    def step(self) -> list[Snapshot]:
        """Let the policy act once in every world.

        Returns:
            A snapshot of every world. Where an episode has ended, it is the state that ended it, with the
            scandots and forces of the step before: those of that state were never computed, or are gone.
        """
        self._obs, _, done, _ = self.env.step(self._policy(self._obs))
        self._policy.reset(done)
        self._reader.count_step()
        before = self._snapshots
        ended = np.flatnonzero(done.cpu().numpy())
        last: dict[int, Snapshot] = {}
        if ended.size:
            qpos, outcomes = self.env.final_qpos.cpu().numpy(), self.env.outcome.cpu().numpy()
            for world in ended.tolist():
                last[world] = replace(
                    before[world],
                    time=self._reader.time(world),
                    qpos=qpos[world, ROBOT].astype(float),
                    outcome=self.env.outcomes[outcomes[world]],
                    target=_moved(before[world].target, qpos[world, OBJECT].astype(float)),
                )
            self._reader.begin(last)
            self.ended.extend(last.values())
        self._snapshots = self._reader.read()
        return [last.get(world, snapshot) for world, snapshot in enumerate(self._snapshots)]


def _moved(target: Target | None, pose: np.ndarray) -> Target | None:
    return None if target is None else replace(target, pose=pose)
