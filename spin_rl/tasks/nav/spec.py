"""The navigation task for `registry.TASKS`."""

from __future__ import annotations

from spin_rl.scenes.corridors.params import GeneratorParams
from spin_rl.tasks.common import rewards
from spin_rl.tasks.common.config import NavConfig
from spin_rl.tasks.common.spec import TaskSpec
from spin_rl.tasks.nav.env import NavEnv
from spin_rl.tasks.nav.observations import GROUPS, OPTIONAL_GROUPS

NAV = TaskSpec(
    name="nav",
    config=NavConfig,
    scene=GeneratorParams,
    make_env=NavEnv,
    groups=(*GROUPS, *OPTIONAL_GROUPS),
    policies={"policy": "nav"},
    reward_terms=rewards.TERMS,
    scene_files=True,
)
