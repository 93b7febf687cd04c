"""Composing a configuration with Hydra, and from there to a task's own: what is the same for every task."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import nullcontext
from typing import Any, TypeVar, cast

import hydra
from hydra.core.global_hydra import GlobalHydra
from omegaconf import DictConfig, OmegaConf

from spin_rl.config import ConfigError, check_value, from_mapping, short
from spin_rl.paths import CONF_DIR
from spin_rl.scenes import kinds
from spin_rl.sensors.depth.pipeline import DepthConfig
from spin_rl.sensors.depth.size import image_shape
from spin_rl.sim.config import SimConfig
from spin_rl.tasks.common import rewards
from spin_rl.tasks.common.config import TaskConfig

Config = TypeVar("Config", bound=TaskConfig)


def compose(name: str, overrides: Sequence[str] = ()) -> dict[str, Any]:
    """Compose a file of conf/ into nested built-in types, also inside a run of Hydra's own.

    Args:
        name: The file, such as `eval`.
        overrides: Hydra overrides, such as `robot=re1`.

    Raises:
        ConfigError: A value is missing.
        HydraException: An override does not fit.
    """
    running = GlobalHydra.instance().is_initialized()  # commands here all search the same folder
    with nullcontext() if running else hydra.initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        return plain(hydra.compose(name, list(overrides)))


def plain(cfg: DictConfig | Mapping[str, Any]) -> dict[str, Any]:
    """Resolve a Hydra configuration into nested built-in types.

    Raises:
        ConfigError: A value is missing.
    """
    if isinstance(cfg, DictConfig):
        missing = OmegaConf.missing_keys(cfg)
        if missing:
            raise ConfigError(f"{min(missing)}: a value is needed")
        return cast(dict[str, Any], OmegaConf.to_container(cfg, resolve=True))
    return dict(cfg)


def task_config(
    cfg: DictConfig | Mapping[str, Any], name: str, kind: type[Config], scene: type, terms: Collection[str]
) -> Config:
    """Build a task's configuration from the groups task, robot, scene, reward, sim and depth.

    Args:
        cfg: Composed configuration; `reward` may be missing, as in evaluation. There is a depth camera if
            `task.depth.enabled` says so, see `with_depth`.
        name: Name of the task.
        kind: Its configuration.
        scene: Parameters of its scenes, a dataclass.
        terms: Its reward terms.

    Raises:
        ConfigError: Another task, an unknown key or an impossible value, named in the message.
    """
    values = plain(cfg)
    task = dict(values["task"])
    given = task.pop("name", None)
    if given != name:
        raise ConfigError(f"task: {short(given)} is not a task of this command; use {name}")
    groups = {
        "robot_profile": _robot_profile(values["robot"]),
        "scene": from_mapping(scene, values["scene"], "scene"),
        "sim": from_mapping(SimConfig, values["sim"], "sim"),
        "reward": _reward(values.get("reward") or {}, terms),
        "depth": from_mapping(DepthConfig, values.get("depth") or {}, "depth"),
    }
    if not depth_is_enabled(task.pop("depth", {})):
        groups["depth"] = None
    for name in groups:
        if name in task:
            raise ConfigError(f"task.{name}: unknown key; it is a group of its own")
    for name in kinds.CHOICES.keys() & task.keys():
        task[name] = kinds.number_of(name, task[name], f"task.{name}")
    return from_mapping(kind, task | groups, "task")


def with_depth(values: Mapping[str, Any]) -> dict[str, Any]:
    """Switch the depth camera on if a model reads it, and tell the model the size of its images.

    Args:
        values: Composed configuration, as plain types, with `runner.obs_groups`.
    """
    runner, task = dict(values["runner"]), dict(values["task"])
    readers = [
        model
        for model, groups in runner["obs_groups"].items()
        if any(str(group).startswith("depth") for group in groups or ())
    ]
    for model in readers:
        section = dict(runner[model])
        image = list(image_shape(task["camera_mount"]))
        section["depth_encoder"] = {"image": image} | dict(section.get("depth_encoder") or {})
        runner[model] = section
    if readers:
        task["depth"] = dict(task.get("depth") or {}) | {"enabled": True}
    return dict(values) | {"runner": runner, "task": task}


def depth_is_enabled(values: Mapping[str, Any]) -> bool:
    """Read the section `task.depth`.

    Raises:
        ConfigError: It has another key, or a value that is neither true nor false.
    """
    unknown = sorted(map(str, set(check_value(dict[str, Any], values, "task.depth")) - {"enabled"}))
    if unknown:
        raise ConfigError(f"task.depth.{unknown[0]}: unknown key; noise and filter are a group of their own")
    enabled = values.get("enabled", False)
    if type(enabled) is not bool:
        raise ConfigError(f"task.depth.enabled: expected true or false, got {enabled!r}")
    return enabled


def _robot_profile(values: Mapping[str, Any]) -> str:
    unknown = sorted(map(str, set(values) - {"profile"}))
    if unknown:
        raise ConfigError(f"robot.{unknown[0]}: unknown key; choose from profile")
    profile = values.get("profile")
    if not isinstance(profile, str):
        raise ConfigError(f"robot.profile: expected a name, got {profile!r}")
    return profile


def _reward(values: Mapping[str, Any], terms: Collection[str]) -> dict[str, float]:
    try:
        return rewards.check_scales(_flat(values), terms)
    except ValueError as error:
        raise ConfigError(str(error)) from error


def _flat(values: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    """Join the keys of nested mappings: `package: {module: {term: 0.1}}` is one term by its full name."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        flat |= _flat(value, f"{above}{key}.") if isinstance(value, Mapping) else {f"{above}{key}": value}
    return flat
