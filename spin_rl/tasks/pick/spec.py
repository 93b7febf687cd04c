"""The pick task for `registry.TASKS`."""

from __future__ import annotations

from spin_rl.scenes.tabletops.params import TabletopParams
from spin_rl.tasks.common.spec import TaskSpec
from spin_rl.tasks.pick import rewards
from spin_rl.tasks.pick.config import PickConfig
from spin_rl.tasks.pick.env import PickEnv
from spin_rl.tasks.pick.observations import PICK_GROUPS, PICK_OPTIONAL_GROUPS

PICK = TaskSpec(
    name="pick",
    config=PickConfig,
    scene=TabletopParams,
    make_env=PickEnv,
    groups=(*PICK_GROUPS, *PICK_OPTIONAL_GROUPS),
    policies={"policy": "pick"},
    reward_terms=rewards.TERMS,
)
