"""From a composed Hydra configuration to a task."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, TypeVar

import hydra
from omegaconf import DictConfig, OmegaConf

from spin_rl.config import ConfigError, from_mapping
from spin_rl.paths import CONF_DIR
from spin_rl.scenes.corridor_tables.params import FetchSceneParams
from spin_rl.scenes.corridors.params import GeneratorParams
from spin_rl.scenes.tabletops.params import TabletopParams
from spin_rl.sensors.depth.pipeline import DepthConfig
from spin_rl.sim import SimConfig
from spin_rl.tasks.common import rewards
from spin_rl.tasks.common.config import NavConfig
from spin_rl.tasks.common.depth import image_shape
from spin_rl.tasks.common.env import TaskEnv
from spin_rl.tasks.fetch import env as fetch
from spin_rl.tasks.fetch.config import FetchConfig
from spin_rl.tasks.nav import env as nav
from spin_rl.tasks.nav.observations import GROUPS, OPTIONAL_GROUPS
from spin_rl.tasks.pick import env as pick
from spin_rl.tasks.pick import rewards as pick_rewards
from spin_rl.tasks.pick.config import PickConfig
from spin_rl.tasks.pick.observations import PICK_GROUPS, PICK_OPTIONAL_GROUPS

T = TypeVar("T")


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


def default_config(overrides: Sequence[str] = ()) -> NavConfig:
    """Return the navigation task as `spin-train` has it.

    Args:
        overrides: Hydra overrides, such as `robot=re1`.
    """
    with hydra.initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        return env_config(hydra.compose("train", list(overrides)))


def env_config(cfg: DictConfig | Mapping[str, Any]) -> NavConfig:
    """Build the navigation task's configuration from the groups task, robot, scene, reward, sim and depth.

    Args:
        cfg: Composed configuration; `reward` may be missing, as in evaluation. There is a depth camera if
            `task.depth.enabled` says so, see `with_depth`.

    Raises:
        ConfigError: An unknown key or an impossible value, named in the message.
    """
    return _task_config(cfg, "nav", NavConfig, GeneratorParams, rewards.TERMS)


def pick_config(cfg: DictConfig | Mapping[str, Any]) -> PickConfig:
    """Build the pick task's configuration from the same groups; see `env_config`."""
    return _task_config(cfg, "pick", PickConfig, TabletopParams, pick_rewards.TERMS)


def fetch_config(cfg: DictConfig | Mapping[str, Any]) -> FetchConfig:
    """Build the fetch task's configuration from the same groups; see `env_config`."""
    return _task_config(cfg, "fetch", FetchConfig, FetchSceneParams, ())


def any_config(cfg: DictConfig | Mapping[str, Any]) -> NavConfig | PickConfig | FetchConfig:
    """Build the configuration of the task that `task.name` names; see `env_config`."""
    builders = {"pick": pick_config, "fetch": fetch_config}
    return builders.get(cfg["task"]["name"], env_config)(cfg)


def observation_groups(task: str) -> tuple[str, ...]:
    """Return the observation groups of the task of a name, those that it may have included."""
    return (*PICK_GROUPS, *PICK_OPTIONAL_GROUPS) if task == "pick" else (*GROUPS, *OPTIONAL_GROUPS)


def make_env(cfg: NavConfig | PickConfig | FetchConfig, num_envs: int, device: str, seed: int) -> TaskEnv:
    """Start a task in a number of worlds on a device."""
    if isinstance(cfg, PickConfig):
        return pick.PickEnv(cfg, num_envs, device, seed=seed)
    if isinstance(cfg, FetchConfig):
        return fetch.FetchEnv(cfg, num_envs, device, seed=seed)
    return nav.NavEnv(cfg, num_envs, device, seed=seed)


def _task_config(
    cfg: DictConfig | Mapping[str, Any], name: str, kind: type[T], scene: type, terms: Collection[str]
) -> T:
    values = plain(cfg)
    task = dict(values["task"])
    given = task.pop("name")
    if given != name:
        raise ConfigError(f"task: {given!r} is not a task of this command; use {name}")
    groups = {
        "robot_profile": _robot_profile(values["robot"]),
        "scene": from_mapping(scene, values["scene"], "scene"),
        "sim": from_mapping(SimConfig, values["sim"], "sim"),
        "reward": _reward(values.get("reward") or {}, terms),
        "depth": from_mapping(DepthConfig, values.get("depth") or {}, "depth"),
    }
    if not _depth_is_enabled(task.pop("depth", {})):
        groups["depth"] = None
    for name in groups:
        if name in task:
            raise ConfigError(f"task.{name}: unknown key; it is a group of its own")
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


def _depth_is_enabled(values: Mapping[str, Any]) -> bool:
    unknown = sorted(set(values) - {"enabled"})
    if unknown:
        raise ConfigError(f"task.depth.{unknown[0]}: unknown key; noise and filter are a group of their own")
    enabled = values.get("enabled", False)
    if type(enabled) is not bool:
        raise ConfigError(f"task.depth.enabled: expected true or false, got {enabled!r}")
    return enabled


def _robot_profile(values: Mapping[str, Any]) -> str:
    unknown = sorted(set(values) - {"profile"})
    if unknown:
        raise ConfigError(f"robot.{unknown[0]}: unknown key; choose from profile")
    profile = values.get("profile")
    if not isinstance(profile, str):
        raise ConfigError(f"robot.profile: expected a name, got {profile!r}")
    return profile


def _reward(values: Mapping[str, Any], terms: Collection[str]) -> dict[str, float]:
    try:
        return rewards.check_scales(dict(values), terms)
    except ValueError as error:
        raise ConfigError(str(error)) from error
