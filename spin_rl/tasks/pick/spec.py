"""The pick task for `registry.TASKS`."""

from __future__ import annotations

from spin_rl.deferred import Deferred
from spin_rl.scenes.tabletops.params import TabletopParams
from spin_rl.tasks.common.spec import TaskSpec
from spin_rl.tasks.pick import rewards
from spin_rl.tasks.pick.config import PickConfig

PICK_GROUPS = ("proprio", "hand", "object_start", "object", "object_at_start", "privileged")
PICK_OPTIONAL_GROUPS = ("depth", "hand_in_image")

PICK = TaskSpec(
    name="pick",
    config=PickConfig,
    scene=TabletopParams,
    make_env=Deferred("spin_rl.tasks.pick.env:PickEnv"),
    groups=(*PICK_GROUPS, *PICK_OPTIONAL_GROUPS),
    policies={"policy": "pick"},
    reward_terms=rewards.TERMS,
)
