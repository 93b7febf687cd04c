"""Following a policy's episodes from beginning to end."""

from __future__ import annotations

import numpy as np
import torch
import warp as wp
from tensordict import TensorDict

from spin_rl import robot
from spin_rl.analysis.behaviour.trace import DriveTrace
from spin_rl.analysis.hits import FLOOR
from spin_rl.analysis.watch import Watch
from spin_rl.policy import Policy
from spin_rl.tasks.common import episode
from spin_rl.tasks.nav.env import NavEnv


class BehaviourWatch(Watch):
    """Records all episodes of one seed.

    Attributes:
        traces: In the order of their end; `condition` is empty.
    """

    def __init__(self, policy: Policy, env: NavEnv, seed: int) -> None:
        """Watch a policy in an environment that only it acts in.

        Args:
            policy: The policy.
            env: The environment.
            seed: What traces are labelled with.
        """
        super().__init__(policy, env)
        self._seed = seed
        hand = env.sim.mj_model.site(robot.GRASP_CENTER_SITE).id
        self._hand = wp.to_torch(env.sim.data.site_xpos)[:, hand]
        self.traces: list[DriveTrace] = []

    def _begin(self) -> None:
        super()._begin()
        self._scenes = self._env.sim.layout.scenes()
        self._record: dict[str, list[torch.Tensor]] = {"qpos": [], "hand": [], "slot_pos": [], "seen": []}

    def _observe(self, obs: TensorDict) -> None:
        super()._observe(obs)
        self._record["qpos"].append(self._last["qpos"].clone())
        self._record["hand"].append(self._hand.clone())
        self._record["slot_pos"].append(self._last["slot_pos"].clone())
        self._record["seen"].append(self._seen_at[:, :-1] == self._step)

    def _end(self, worlds: torch.Tensor) -> None:
        rows = self._rows(worlds)
        outcomes = self._env.outcome[worlds].tolist()
        kept = {
            name: torch.stack([values[worlds] for values in steps]).cpu().numpy()
            for name, steps in self._record.items()
        }
        for i, world in enumerate(worlds.tolist()):
            hits: list[tuple[str, int]] = []
            if outcomes[i] == episode.COLLISION:
                touches = self._nearest.find(world, rows["slot_pos"][i], rows["qpos"][i], rows["parts"][i])
                hits = [(touch.part, touch.slot) for touch in touches if touch.slot != FLOOR]
            self.traces.append(
                DriveTrace(
                    condition="",
                    seed=self._seed,
                    world=world,
                    outcome=episode.OUTCOMES[outcomes[i]],
                    period=self._period,
                    scene=self._scenes[world],
                    qpos=kept["qpos"][:, i].astype(np.float64),
                    hand=kept["hand"][:, i].astype(np.float64),
                    slot_pos=kept["slot_pos"][:, i].astype(np.float64),
                    seen=kept["seen"][:, i],
                    hits=tuple(hits),
                )
            )
