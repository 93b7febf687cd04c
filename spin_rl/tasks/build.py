"""From a composed Hydra configuration to a task."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from omegaconf import DictConfig, OmegaConf

from spin_rl.config import ConfigError, from_mapping
from spin_rl.tasks.nav import NavConfig


def plain(cfg: DictConfig | Mapping[str, Any]) -> dict[str, Any]:
    """Resolve a Hydra configuration into nested built-in types.

    Raises:
        ConfigError: A value is missing.
    """
    if isinstance(cfg, DictConfig):
        missing = OmegaConf.missing_keys(cfg)
        if missing:
            raise ConfigError(f"{min(missing)}: a value is needed")
        return OmegaConf.to_container(cfg, resolve=True)  # type: ignore[return-value]
    return dict(cfg)


def env_config(cfg: DictConfig | Mapping[str, Any]) -> NavConfig:
    """Build the navigation task's configuration from the groups task, robot, scene, reward and sim.

    Args:
        cfg: Composed configuration; `reward` may be missing, as in evaluation.

    Raises:
        ConfigError: An unknown key or an impossible value, named in the message.
    """
    values = plain(cfg)
    task = dict(values["task"])
    name = task.pop("name")
    if name != "nav":
        raise ConfigError(f"task: {name!r} is not a task of this command; use nav")
    return from_mapping(
        NavConfig,
        task
        | {
            "robot_profile": values["robot"]["profile"],
            "scene": values["scene"],
            "sim": values["sim"],
            "reward": values.get("reward", {}),
        },
        "task",
    )
