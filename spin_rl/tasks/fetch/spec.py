"""The fetch task for `registry.TASKS`."""

from __future__ import annotations

from spin_rl.scenes.corridor_tables.params import FetchSceneParams
from spin_rl.tasks.common.spec import TaskSpec
from spin_rl.tasks.fetch.config import FetchConfig
from spin_rl.tasks.fetch.env import FetchEnv
from spin_rl.tasks.fetch.policy import FetchPolicy
from spin_rl.tasks.nav.spec import NAV
from spin_rl.tasks.pick.spec import PICK

FETCH = TaskSpec(
    name="fetch",
    config=FetchConfig,
    scene=FetchSceneParams,
    make_env=FetchEnv,
    groups=tuple(dict.fromkeys((*NAV.groups, *PICK.groups, "stage"))),
    policies={"policy": NAV.name, "pick": PICK.name},
    join=FetchPolicy,
    untrainable="fetch cannot be trained; train task=nav and task=pick, see docs/fetch.md",
)
