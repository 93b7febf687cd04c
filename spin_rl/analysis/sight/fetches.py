"""Whole fetches: which constant head poses would have shown the object, beside the obstacles on the way."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
import warp as wp

from spin_rl.analysis.sight import judge
from spin_rl.analysis.sight.heads import Poses
from spin_rl.analysis.sight.options import SightOptions
from spin_rl.analysis.sight.record import SightWatch
from spin_rl.policy import Policy
from spin_rl.tasks.fetch.config import STAGES
from spin_rl.tasks.fetch.env import FetchEnv
from spin_rl.warp_kernels.sight import BITS, look
from spin_rl.warp_kernels.slots import Slots, slots_of

REACH, ALIGN, PICK, CARRY = (STAGES.index(stage) for stage in ("reach", "align", "pick", "carry"))
_ENDED = -1


@dataclass(frozen=True)
class ObjectRecord:
    """First fetches of worlds, one observation a row, as `Record`.

    Attributes:
        stage: Stage of the fetch, index into `STAGES`, -1 after its end, shape (steps, worlds), int.
        shown: Words of head poses that would have shown the object, shape (steps, worlds, words), uint32.
    """

    stage: np.ndarray
    shown: np.ndarray


class FetchWatch(SightWatch):
    """Records fetches: obstacles while a policy drives, and the object all the time.

    Attributes:
        objects: What was recorded of the objects, as `records`.
    """

    def __init__(self, policy: Policy, env: FetchEnv, poses: Poses, *, lead_s: float, near_m: float) -> None:
        """Watch; see `SightWatch`."""
        super().__init__(policy, env, poses, lead_s=lead_s, near_m=near_m)
        self._fetch = env
        n, sim = env.num_envs, env.sim
        with wp.ScopedDevice(env.device):
            self._object = Slots()
            self._object.pos = wp.zeros((n, 1), dtype=wp.vec3)
            self._object.yaw = wp.zeros((n, 1), dtype=float)
            self._object.half_size = sim.object.half_extents.reshape((n, 1))
            self._object.active = wp.full((n, 1), True, dtype=bool)
            self._object.is_cylinder = wp.zeros(1, dtype=bool)
            self._no_wall = wp.zeros(1, dtype=bool)
            self._object_shown = wp.zeros((n, 1, (len(poses) + BITS - 1) // BITS), dtype=wp.uint32)
        self._place = wp.to_torch(self._object.pos)
        self._scene = slots_of(sim.layout)
        self.objects: list[ObjectRecord] = []

    def _observe(self) -> None:
        super()._observe()
        env, sim = self._fetch, self._fetch.sim
        self._place[:, 0] = sim.object.views.pos
        look(
            self._object,
            self._scene,
            self._no_wall,
            sim.layout.nearby,
            sim.data.qpos,
            self._body,
            self._heads,
            window=env.cfg.sight.far_m,
            shown_out=self._object_shown,
        )
        step = self._steps[-1]
        step["stage"] = torch.where(step["running"], env.stage, _ENDED)
        step["object"] = wp.to_torch(self._object_shown.view(wp.int32))[:, 0].clone()
        # What the scripts of the other stages drive up to, the table above all, they know.
        step["running"] = step["running"] & ((env.stage == REACH) | (env.stage == CARRY))

    def finish(self) -> None:
        """Add what was recorded since the last full reset to `records` and `objects`."""
        if self._steps:
            stage, shown = (torch.stack([step[name] for step in self._steps]) for name in ("stage", "object"))
            self.objects.append(ObjectRecord(stage.cpu().numpy(), shown.cpu().numpy().view(np.uint32)))
        super().finish()


def object_events(record: ObjectRecord, num_poses: int, options: SightOptions, period: float) -> judge.Events:
    """When an object had to be seen: by the time the robot stands at the table, and when the hand is there.

    Until the table, anything seen of it is remembered, since it stands there. When the pick begins the object
    must be in view, for as long as moving things are known (`fresh_s`). A fetch that did not come so far asks
    for less.

    Args:
        record: Of one seed.
        num_poses: Number of head poses.
        options: How long what was seen is known.
        period: Time between two observations [s].
    """
    bits = judge.bits_of(record.shown, num_poses)
    steps, worlds = record.stage.shape
    when = np.arange(steps)
    parts = []
    for stage, memory_s in ((ALIGN, np.inf), (PICK, options.fresh_s)):
        entered = record.stage == stage
        world = np.flatnonzero(entered.any(axis=0))
        step = entered[:, world].argmax(axis=0)
        late = (step[:, None] - when) * period
        known = (late >= 0.0) & (late <= memory_s + 1e-9)
        shows = bits[:, world].transpose(1, 0, 2) & known[..., None]
        parts.append(judge.Events(world, step, shows, worlds))
    return judge.together(parts)


def fetch_groups(
    watches: list[FetchWatch], num_poses: int, options: SightOptions, period: float
) -> dict[str, judge.Events]:
    """Events of whole fetches, and of their two halves: obstacles on the way, and the object."""
    halves: dict[str, list[judge.Events]] = {"driving": [], "object": []}
    for watched in watches:
        for record, seen in zip(watched.records, watched.objects, strict=True):
            halves["driving"].append(judge.find_events(record, num_poses, options, period))
            halves["object"].append(object_events(seen, num_poses, options, period))
    whole: list[judge.Events] = [judge.together(list(pair)) for pair in zip(*halves.values(), strict=True)]
    found: dict[str, Any] = {"whole fetch": whole} | halves
    return {name: judge.join(parts) for name, parts in found.items()}
