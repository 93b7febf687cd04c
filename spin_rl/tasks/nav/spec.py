"""The navigation task for `registry.TASKS`."""

from __future__ import annotations

from spin_rl.scenes.rooms.params import scene_class
from spin_rl.tasks.common.spec import TaskSpec
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.env import NavEnv
from spin_rl.tasks.nav.observations import NAV_GROUPS, NAV_OPTIONAL_GROUPS
from spin_rl.tasks.nav.rewards import TERMS

NAV = TaskSpec(
    name="nav",
    config=NavConfig,
    scene=scene_class,
    make_env=NavEnv,
    groups=(*NAV_GROUPS, *NAV_OPTIONAL_GROUPS),
    policies={"policy": "nav"},
    reward_terms=TERMS,
    scene_files=True,
)
