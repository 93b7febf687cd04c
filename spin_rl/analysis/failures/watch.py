"""Following failed episodes: what the robot hit with what, when, where, and whether it had been seen."""

from __future__ import annotations

from collections import deque
from dataclasses import astuple, replace
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict

from spin_rl.analysis.failures.failure import Failure
from spin_rl.analysis.failures.names import base_velocity, kind_of, manner_of, motion_of, place_of
from spin_rl.analysis.failures.width import free_width
from spin_rl.analysis.hits import FLOOR, Touch
from spin_rl.analysis.watch import NEVER, Watch
from spin_rl.policy import Policy
from spin_rl.scenes.layout import Scene
from spin_rl.tasks.common import episode
from spin_rl.tasks.nav.env import NavEnv

LATE_S = 10.0
"""How long before its end an episode is looked at for what the base did."""


class FailureWatch(Watch):
    """Collects the failures of one seed.

    Attributes:
        failures: In the order of their end.
        durations_s: Of all episodes, in the order of their end [s].
    """

    def __init__(self, policy: Policy, env: NavEnv, seed: int) -> None:
        """Watch a policy in an environment that only it acts in.

        Args:
            policy: The policy.
            env: The environment.
            seed: What failures are labelled with.
        """
        super().__init__(policy, env)
        self._seed = seed
        self.failures: list[Failure] = []
        self.durations_s: list[float] = []

    def _begin(self) -> None:
        super()._begin()
        self._scenes = self._env.sim.layout.scenes()
        self._travelled = torch.zeros(self._env.num_envs, device=self._env.device)
        self._left = self._env.way_left.clone()
        # Of the base, one for every observation and the one before.
        self._poses: deque[torch.Tensor] = deque(maxlen=1 + round(LATE_S / self._period))

    def _observe(self, obs: TensorDict) -> None:
        before = self._last["qpos"][:, :2].clone()
        super()._observe(obs)
        self._travelled += (self._last["qpos"][:, :2] - before).norm(dim=-1)
        self._left.copy_(self._env.way_left)
        self._poses.append(self._last["qpos"][:, :3].clone())

    def _end(self, worlds: torch.Tensor) -> None:
        # The step that ended the episodes came after the last observation.
        time_s = round((self._step + 1) * self._period, 3)
        self.durations_s += [time_s] * len(worlds)
        worlds = worlds[self._env.outcome[worlds] != episode.SUCCESS]
        if not len(worlds):
            return
        rows = self._rows(worlds)
        late = torch.stack([poses[worlds] for poses in self._poses], dim=1)
        more = {
            "outcome": self._env.outcome[worlds],
            "travelled": self._travelled[worlds],
            "way": self._env.final_way[worlds],
            "left": self._left[worlds],
            "late": late,
        }
        rows |= {name: values.cpu().numpy() for name, values in more.items()}
        for i, world in enumerate(worlds.tolist()):
            state = {name: values[i] for name, values in rows.items()}
            self.failures.append(self._describe(world, time_s, state))

    def _describe(self, world: int, time_s: float, state: dict[str, np.ndarray]) -> Failure:
        qpos = state["qpos"]
        scene = replace(self._scenes[world], pos=state["slot_pos"].astype(float))
        touches: list[Touch] = []
        if state["outcome"] == episode.COLLISION:
            touches = self._nearest.find(world, state["slot_pos"], qpos, state["parts"])
        slot = touches[0].slot if touches and touches[0].slot != FLOOR else None
        width = free_width(scene, qpos[:2], slot)
        return Failure(
            seed=self._seed,
            world=world,
            outcome=episode.OUTCOMES[state["outcome"]],
            time_s=time_s,
            travelled_m=round(float(state["travelled"]), 3),
            to_go_m=round(float(np.hypot(*(scene.goal - qpos[:2]))), 3),
            way_m=round(float(state["way"]), 3),
            left_m=round(float(state["left"]), 3),
            place=place_of(scene, qpos[:2]),
            parts=[touch.part for touch in touches],
            hits=[kind_of(scene, touch.slot) for touch in touches],
            point_b=[round(float(value), 4) for value in touches[0].point_b] if touches else None,
            width_m=None if width is None else round(width, 3),
            qpos=[round(float(value), 5) for value in qpos],
            goal=[round(float(value), 4) for value in scene.goal],
            pool=list(astuple(scene.pool)),
            slots=_rows_of(scene),
            **_describe_motion(state, self._period),
            **self._describe_slot(scene, slot, state),
        )

    def _describe_slot(self, scene: Scene, slot: int | None, state: dict[str, np.ndarray]) -> dict[str, Any]:
        nothing = {"moving": False, "behind_corner": False, "seen": None, "unseen_s": None}
        if slot is None:
            return nothing | {"slot": None}
        seen_at = int(state["seen_at"][slot])
        steps = None if seen_at == NEVER else self._step - seen_at
        moving = bool(scene.motion_speed[slot] > 0.0)
        # What moves may come out of a wall, and be on neither side of the corner yet.
        stands = (scene.home if moving else scene.pos)[slot, :2]
        return {
            "slot": slot,
            "moving": moving,
            "behind_corner": not scene.is_wall[slot] and place_of(scene, stands) == "behind corner",
            "seen": "never" if steps is None else "before" if steps else "in view",
            "unseen_s": None if steps is None else round(steps * self._period, 3),
        }


def _describe_motion(state: dict[str, np.ndarray], period: float) -> dict[str, Any]:
    speed, turn = base_velocity(state["qpos"], state["qvel"])
    late = state["late"]
    driven = float(np.linalg.norm(np.diff(late[:, :2], axis=0), axis=1).sum())
    turned = float(late[-1, 2] - late[0, 2])
    return {
        "forward_m_s": round(speed, 3),
        "turn_rad_s": round(turn, 3),
        "motion": motion_of(speed, turn),
        "late_m": round(driven, 3),
        "late_turn_rad": round(turned, 3),
        "manner": manner_of(driven, turned, (len(late) - 1) * period),
    }


def _rows_of(scene: Scene) -> list[list[float]]:
    slots = np.flatnonzero(scene.active)
    table = np.column_stack([slots, scene.pos[slots], scene.yaw[slots], scene.half_size[slots]])
    return np.round(table.astype(float), 4).tolist()
