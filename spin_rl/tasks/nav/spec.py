"""The navigation task for `registry.TASKS`."""

from __future__ import annotations

from spin_rl.deferred import Deferred
from spin_rl.scenes.rooms.params import scene_class
from spin_rl.tasks.common.spec import TaskSpec
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.rewards import TERMS

NAV_GROUPS = ("proprio", "goal", "scandots", "scandots_all", "way")
NAV_OPTIONAL_GROUPS = ("scandots_map", "lidar", "odometry", "gaze", "depth")

NAV = TaskSpec(
    name="nav",
    config=NavConfig,
    scene=scene_class,
    make_env=Deferred("spin_rl.tasks.nav.env:NavEnv"),
    groups=(*NAV_GROUPS, *NAV_OPTIONAL_GROUPS),
    policies={"policy": "nav"},
    reward_terms=TERMS,
    scene_files=True,
)
