"""Pictures of all worlds of an environment that somebody else steps."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from spin_rl.tasks.common.env import TaskEnv
from spin_rl.viewer.picture import PictureMaker
from spin_rl.viewer.reader import SnapshotReader
from spin_rl.viewer.stage import Stage


class WorldPictures:
    """Follows an environment; tell it of every step and new episode, as a `SnapshotReader`."""

    def __init__(self, env: TaskEnv, title: str) -> None:
        """Take over an environment at the start of its episodes.

        Args:
            env: Environment that leaves worlds that ended as they are, see `TaskEnv.keep_ends`.
            title: What plays.
        """
        self._env = env
        self._title = title
        self._reader = SnapshotReader(env)
        self._makers: list[PictureMaker] = []
        self.restart = self._reader.restart
        self.count_step = self._reader.count_step

    def begin(self, worlds: Iterable[int]) -> None:
        """Some worlds are at the start of their next episodes."""
        self._reader.begin(worlds)

    def draw(self) -> tuple[np.ndarray, ...]:
        """Return a picture of every world now, shape (rows, columns, 3) each, uint8."""
        outcomes = self._env.outcome.tolist()
        snapshots = [
            snapshot if snapshot.time == 0.0 else replace(snapshot, outcome=self._env.outcomes[outcome])
            for snapshot, outcome in zip(self._reader.read(), outcomes, strict=True)
        ]
        if not self._makers:  # compiles
            period = self._env.cfg.sim.control_period
            pool, mount = self._env.sim.layout.pool, self._env.cfg.camera_mount
            with_object = snapshots[0].target is not None
            self._makers = [
                PictureMaker(Stage(pool, mount, with_object=with_object), self._title, period, samples=1)
                for _ in snapshots
            ]
        makers = zip(self._makers, snapshots, strict=True)
        return tuple(np.asarray(maker.draw(snapshot)) for maker, snapshot in makers)
