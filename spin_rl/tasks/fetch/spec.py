"""The fetch task for `registry.TASKS`."""

from __future__ import annotations

from spin_rl.deferred import Deferred
from spin_rl.scenes.corridor_tables.params import FetchSceneParams
from spin_rl.tasks.common.spec import TaskSpec
from spin_rl.tasks.fetch.config import FetchConfig
from spin_rl.tasks.nav.spec import NAV
from spin_rl.tasks.pick.spec import PICK

_NAV_ALONE = ("way", "lidar", "odometry", "gaze")
"""Groups of navigation that fetches lack: what only critics and baselines read."""

FETCH = TaskSpec(
    name="fetch",
    config=FetchConfig,
    scene=FetchSceneParams,
    make_env=Deferred("spin_rl.tasks.fetch.env:FetchEnv"),
    groups=tuple(
        dict.fromkeys((*(group for group in NAV.groups if group not in _NAV_ALONE), *PICK.groups, "stage"))
    ),
    policies={"policy": NAV.name, "pick": PICK.name},
    join=Deferred("spin_rl.tasks.fetch.policy:FetchPolicy"),
    untrainable="fetch cannot be trained; train task=nav and task=pick, see docs/fetch.md",
)
