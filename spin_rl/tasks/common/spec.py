"""What the commands know of a task."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic

from omegaconf import DictConfig

from spin_rl.config import check_value
from spin_rl.policy import Policy
from spin_rl.tasks.common.compose import Config, compose, depth_is_enabled, task_config
from spin_rl.tasks.common.rewards import Term

if TYPE_CHECKING:
    from spin_rl.tasks.common.env import TaskEnv


def alone(policy: Policy) -> Policy:
    """Return the one policy of a task in which none take turns."""
    return policy


@dataclass(frozen=True)
class TaskSpec(Generic[Config]):
    """A task, as all that runs, measures and shows tasks sees it; see `registry.TASKS`.

    Attributes:
        name: Its name, also of its file in conf/task.
        config: Its configuration.
        scene: Parameters of its scenes, a dataclass: the group `scene` of the configuration; or what finds
            it for the values of the group.
        make_env: Starts it: configuration, number of worlds, device and seed; with `scene_files` also, by
            keyword, `scene`, a fixed scene for all worlds.
        groups: Observation groups that it has, or has with depth images.
        policies: Which policies take turns in it: by the key that names each on a command line, the task
            that it was trained in.
        join: Makes one policy of them, given in that order.
        reward_terms: Its reward terms by name; none in a task without a reward.
        untrainable: Why it cannot be trained and what can be; None for one that can.
        scene_files: Whether it can be played in a scene file.
    """

    name: str
    config: type[Config]
    scene: type | Callable[[Mapping[str, Any]], type]
    make_env: Callable[..., TaskEnv]
    groups: tuple[str, ...]
    policies: Mapping[str, str]
    join: Callable[..., Policy] = alone
    reward_terms: Mapping[str, Term] = field(default_factory=dict)
    untrainable: str | None = None
    scene_files: bool = False

    def configure(self, cfg: DictConfig | Mapping[str, Any]) -> Config:
        """Build the task's configuration of a composed one; see `compose.task_config`.

        Raises:
            ConfigError: Another task, an unknown key or an impossible value, named in the message.
        """
        scene = self.scene if isinstance(self.scene, type) else self.scene(cfg["scene"])
        return task_config(cfg, self.name, self.config, scene, self.reward_terms)

    def check(self, cfg: Mapping[str, Any]) -> None:
        """Reject what no policy makes right, before one is read: that takes Torch.

        Raises:
            ConfigError: As `configure`.
        """
        depth = check_value(dict[str, Any] | None, cfg["task"].get("depth"), "task.depth")
        depth_is_enabled(depth or {})
        images = {"depth": {**(depth or {}), "enabled": True}}
        self.configure({**cfg, "task": {**cfg["task"], **images}})

    def as_trained(self, overrides: Sequence[str] = ()) -> Config:
        """Return the configuration that `spin-train` has.

        Args:
            overrides: Hydra overrides, such as `robot=re1`.
        """
        return self.configure(compose("train", [f"task={self.name}", *overrides]))
