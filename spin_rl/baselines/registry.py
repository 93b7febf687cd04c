"""The baselines by name: policies that nobody trained, with what they need of the task."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from spin_rl.config import ConfigError
from spin_rl.deferred import Deferred
from spin_rl.policy import PolicyFactory


@dataclass(frozen=True)
class Baseline:
    """A policy that stands for another way to do a task.

    Attributes:
        make: Makes it.
        needs: What of the task's configuration it needs, nested as in a training's; it names the task.
    """

    make: PolicyFactory
    needs: Mapping[str, Any]

    @property
    def task(self) -> str:
        """Name of the task that it acts in."""
        return self.needs["task"]["name"]

    def check(self, name: str, task: Any) -> None:
        """Reject a task's configuration in which it cannot act, such as one without its sensor.

        Raises:
            ConfigError: One line that names the key.
        """
        if not task.lidar.enabled:
            raise ConfigError(f"task.lidar.enabled: policy={name} drives by the lidar")
        if task.goal_range_m is not None:
            raise ConfigError(f"task.goal_range_m: policy={name} needs the goal where it is, in its map")


_BY_LIDAR = {"task": {"name": "nav", "lidar": {"enabled": True}}}

BASELINES: Mapping[str, Baseline] = MappingProxyType(
    {
        "classical": Baseline(
            lambda obs, device: Deferred("spin_rl.baselines.lidar_stack.policy:LidarStack")(device),
            _BY_LIDAR,
        ),
        # What the lidar shows on the way is not marked: ways lead through the map that was made before.
        "classical-map": Baseline(
            lambda obs, device: Deferred("spin_rl.baselines.lidar_stack.policy:by_map_alone")(device),
            _BY_LIDAR,
        ),
    }
)
"""Name -> baseline."""
