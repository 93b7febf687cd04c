"""The configuration of an evaluation: conf/eval.yaml, with the body and inputs that the policy knows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, cast

from omegaconf import OmegaConf

from spin_rl.config import ConfigError
from spin_rl.groups import OBJECT
from spin_rl.paths import CONF_DIR
from spin_rl.tasks.common.config import TaskConfig

# What of a training the benchmark that follows it takes over: its scenes and its camera's noise.
_CONDITIONS = ("scene", "depth")
_CAMERA_ACTIONS = ("task.camera_action", "task.camera_frozen_after_s")
_RANGE = ("near_m", "far_m")
"""What of a depth filter is the policy's own: how metres become the image that it reads."""


def for_policy(
    values: Mapping[str, Any], trained: Mapping[str, Any] | None, overridden: Sequence[str]
) -> dict[str, Any]:
    """Take over what a policy was trained with, except for what the user asked for.

    Args:
        values: Composed conf/eval.yaml.
        trained: Configuration of the policy's training, nested; None or empty changes nothing.
        overridden: Overrides of the command line, such as `robot=re1` or `task.camera_mount=landscape`.

    Returns:
        A new configuration.
    """
    result = OmegaConf.create(dict(values))
    asked = {override.lstrip("+~").partition("=")[0] for override in overridden}
    source = OmegaConf.create(dict(trained or {}))
    # What defines a policy's body and inputs; everything else is the benchmark's.
    keys = [
        "robot.profile",
        "task.camera_mount",
        "task.camera_pose",
        *_CAMERA_ACTIONS,
        "task.pick_range_m",
        "task.goal_range_m",
        "task.tell_table",
    ]
    sections = ["task.scandots", "task.map", "task.sight", "task.manipulation", "task.depth"]
    sections += ["task.lidar", "task.odometry", "task.guard", "task.planner"]
    if OmegaConf.select(source, "task.depth.enabled"):
        sections.append("depth.filter")
    for section in sections:
        keys += [f"{section}.{name}" for name in OmegaConf.select(source, section) or ()]
    if OBJECT in (OmegaConf.select(source, "runner.obs_groups.actor") or ()):
        keys.append("task.detector")
    for key in keys:
        value = OmegaConf.select(source, key)
        by_user = {key, key.rpartition(".")[0], key.partition(".")[0]} - {"task"}
        if key.startswith(("task.camera_pose", "task.scandots.")):  # camera=<file> is about these
            by_user |= {"camera"}
        if key.rpartition(".")[2] in _RANGE:  # depth=<file> is about the camera and what mends its images
            by_user -= {"depth"}
        if value is not None and not by_user & asked:
            OmegaConf.update(result, key, value, force_add=True)
    return cast(dict[str, Any], OmegaConf.to_container(result))


def of_fetch(nav: Mapping[str, Any], pick: Mapping[str, Any]) -> dict[str, Any]:
    """Join what the two policies of a fetch were trained with, for `for_policy`.

    Args:
        nav: Configuration of the navigation policy's training, nested; empty for one that learned nothing.
        pick: Of the pick policy's.

    Raises:
        ConfigError: They were trained for different robots, cameras or depth filters; one robot has one each.
            The range of depths that a policy reads is its own. Or the one that drives has other camera
            actions than targets of the head.
    """
    sources = [OmegaConf.create(dict(trained)) for trained in (nav, pick)]
    refuse_camera_actions(nav, "a fetch")
    seeing = [source for source in sources if OmegaConf.select(source, "task.depth.enabled")]
    joint = OmegaConf.create({"task": {"depth": {"enabled": bool(seeing)}}})
    for source in sources:
        for section in ("scandots", "sight", "manipulation"):
            values = OmegaConf.select(source, f"task.{section}")
            if values is not None:
                OmegaConf.update(joint, f"task.{section}", values, force_add=True)
    has_map = _has_map(nav)
    if has_map:
        OmegaConf.update(joint, "task.map", OmegaConf.select(sources[0], "task.map"), force_add=True)
    if (goal_range := OmegaConf.select(sources[0], "task.goal_range_m")) is not None:
        OmegaConf.update(joint, "task.goal_range_m", goal_range, force_add=True)
    if OmegaConf.select(sources[0], "runner.actor.encoder") == "concat":  # a fixed number of tokens
        OmegaConf.update(joint, "task.tell_table", False, force_add=True)
    read = OmegaConf.select(seeing[0], "depth.filter") if seeing else None
    for name in _RANGE:
        if read is not None and name in read:
            OmegaConf.update(joint, f"depth.filter.{name}", read[name], force_add=True)
    ranges = [[OmegaConf.select(source, f"depth.filter.{name}") for name in _RANGE] for source in seeing]
    if len(seeing) == 2 and ranges[0] != ranges[1]:
        OmegaConf.update(joint, "task.pick_range_m", ranges[1], force_add=True)
    filters = [f"depth.filter.{name}" for name in read or () if name not in _RANGE]
    for key in ("robot.profile", "task.camera_mount", "task.camera_pose", *filters):
        users = seeing if key in filters else [source for source in sources if source]
        if key == "task.camera_pose" and has_map:  # nothing was seen by the camera that was held
            users = users[1:]
        values = [OmegaConf.select(source, key) for source in users]
        if any(value != values[0] for value in values):
            raise ConfigError(f"pick: {key} is {values[1]} there and {values[0]} in the policy that drives")
        if values and values[0] is not None:
            OmegaConf.update(joint, key, values[0], force_add=True)
    return cast(dict[str, Any], OmegaConf.to_container(joint))


def told_pose(nav: Mapping[str, Any]) -> Sequence[float] | None:
    """Pose of the camera in the training of a policy that drives by a map; None of one that sees.

    Args:
        nav: Configuration of its training, nested; empty for one that learned nothing.
    """
    return nav["task"].get("camera_pose") if _has_map(nav) else None


def _has_map(nav: Mapping[str, Any]) -> bool:
    task = nav.get("task") or {}
    return bool((task.get("map") or {}).get("enabled"))


def refuse_camera_actions(trained: Mapping[str, Any], where: str) -> None:
    """Reject a policy whose camera actions are more than targets of the head, where they are taken as such.

    Args:
        trained: Configuration of its training, nested.
        where: What takes them so.

    Raises:
        ConfigError: One line that names the setting.
    """
    task = trained.get("task") or {}
    for key in _CAMERA_ACTIONS:
        value = task.get(key.partition(".")[2])
        if value not in (None, "target"):
            raise ConfigError(f"policy: it was trained with {key}={value}, which {where} does not have")


def group_of(override: str) -> str:
    """Return the group of the configuration that an override belongs to."""
    return override.lstrip("+~").partition("=")[0].partition(".")[0]


def conditions(overrides: Sequence[str]) -> list[str]:
    """Pick the overrides of a training that say in which scenes and with which images to measure it."""
    return [override for override in overrides if group_of(override) in _CONDITIONS]


def unused_depth(task: TaskConfig, overridden: Sequence[str]) -> str | None:
    """Say that the user chose depth images which nothing reads; None where all is well.

    Args:
        task: Configuration of the evaluation, with what the policy was trained with.
        overridden: Overrides of the command line.
    """
    asked = [override for override in overridden if group_of(override) == "depth"]
    if task.depth is not None or not asked:
        return None
    return f"depth: {asked[0]} changes nothing, since this policy reads no images"


def unused_cell(overridden: Sequence[str]) -> str | None:
    """Say that the user chose corridors of a kind, where benchmarks run all kinds; None where all is well.

    Args:
        overridden: Overrides of the command line.
    """
    for override in overridden:
        key = override.lstrip("+~").partition("=")[0]
        if key in ("task.scenario", "task.difficulty"):
            return f"{key}: changes nothing, since a benchmark runs all of them; see the rows of its table"
    return None


def noise_label(noise: Mapping[str, Any]) -> str:
    """Name a depth camera's noise after the most similar file in conf/depth, and what differs from it.

    Args:
        noise: `DepthNoiseConfig` as a mapping, also one read from JSON.

    Returns:
        Such as `d435i`, or `d435i, patches=0`.
    """
    labels = []
    for file in sorted((CONF_DIR / "depth").glob("*.yaml")):
        named = cast(dict[str, Any], OmegaConf.to_container(OmegaConf.load(file)))["noise"]
        changes = [f"{key}={value}" for key, value in noise.items() if _listed(value) != named[key]]
        labels.append([file.stem, *changes])
    return ", ".join(min(labels, key=len))


def _listed(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def scene_label(overridden: Sequence[str], own: str = "nav") -> str | None:
    """Name the distribution of scenes, None for the benchmark's own.

    Args:
        overridden: Overrides of the command line; those of single values are part of the name.
        own: Name of the benchmark's own.
    """
    asked = [override for override in overridden if group_of(override) == "scene"]
    choices = [override.partition("=")[2] for override in asked if override.startswith("scene=")]
    choice = choices[-1] if choices else own
    changes = [override for override in asked if not override.startswith("scene=")]
    return None if choice == own and not changes else ", ".join([choice, *changes])
