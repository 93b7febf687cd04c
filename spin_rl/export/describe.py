"""From a trained policy to the contract that its exported file holds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from spin_rl import __version__, robot
from spin_rl.benchmark.settings import refuse_camera_actions
from spin_rl.config import ConfigError, from_mapping
from spin_rl.deploy import contract as parts
from spin_rl.deploy.contract import Contract
from spin_rl.export.groups import describe_group
from spin_rl.export.pilot import describe_pilot
from spin_rl.groups import is_depth
from spin_rl.machine import commit
from spin_rl.runners.policy_file import TrainedPolicy, find_policy
from spin_rl.sensors.depth.filter_config import DepthFilterConfig
from spin_rl.sensors.depth.size import image_shape
from spin_rl.sim.config import SimConfig
from spin_rl.sim.manipulation import ManipulationConfig

_RESET = (
    "At the start of an episode, and after any pause: the memory takes its initial value, the depth filter "
    "forgets, the last action is the one that holds the present pose, and the joints' targets are where they "
    "are."
)
_NO_SCANDOTS = "it reads the corners of obstacles (scandots), which only a simulator knows"
_DYNAMICS = ("base_lag_s", "joint_lag_s", "speed_scale", "acceleration_scale")


def describe(policy: TrainedPolicy, units: int, pilot: Mapping[str, Any] | None = None) -> Contract:
    """Write a contract; the parity is not known yet.

    Args:
        policy: Of a run whose configuration is known.
        units: Units of its LSTM.
        pilot: `guard` and `planner` of a task, to drive with other ones than those of the training.

    Raises:
        ConfigError: Its task is none that a single policy is exported for, or it reads what no robot tells.
    """
    config, metadata = policy.config, policy.metadata
    if not config:
        raise ConfigError(f"policy: {policy.name} does not say how it was trained")
    refuse_camera_actions(config, "an exported policy")
    task, names = config["task"], tuple(metadata["obs_groups"])
    guard, planner, shapes = describe_pilot(task | (pilot or {}))
    reads_images = any(is_depth(name) for name in names)
    camera, depth_filter = _camera(config, reads_images, bool(shapes))
    dims = metadata["obs_dims"]
    groups = tuple(describe_group(name, dims[name], camera) for name in names)
    is_simulated = any(group.source == "simulation" for group in groups)
    return Contract(
        format=parts.FORMAT,
        program=f"spin_rl {__version__}, {commit() or 'not in a checkout'}",
        name=find_policy(policy.name).stem,
        task=task["name"],
        observation_names=names,
        observations=groups,
        action_names=robot.ACTIONS,
        actions=_actions(config),
        joint_names=robot.JOINTS,
        default_joint_pos=tuple(robot.STOWED[joint] for joint in robot.JOINTS),
        rate_hz=round(1.0 / from_mapping(SimConfig, config["sim"], "sim").control_period, 6),
        camera=camera,
        depth_filter=depth_filter,
        scandots=from_mapping(parts.Scandots, task["scandots"], "task.scandots") if is_simulated else None,
        goal=parts.Goal(task.get("goal_range_m"), task["goal_tolerance_m"]) if "goal" in names else None,
        speed_profile=_profile(config["robot"]["profile"]),
        state={name: parts.Memory(following, (1, 1, units), 0.0) for name, following in parts.STATE.items()},
        reset=_RESET,
        simulation_only=_NO_SCANDOTS if is_simulated else None,
        training=_training(metadata, task),
        parity=None,
        model_card=_card(policy.name),
        guard=guard,
        planner=planner,
        shapes=shapes,
    )


def _camera(
    config: Mapping[str, Any], reads_images: bool, has_pilot: bool
) -> tuple[parts.Camera, DepthFilterConfig | None]:
    mount, pose = config["task"]["camera_mount"], config["task"].get("camera_pose")
    tangents = robot.camera_tan_half_fov(mount)
    fov = tuple(math.degrees(2.0 * math.atan(tangent)) for tangent in tangents)
    values = {"mount": mount, "fov_deg": fov, "pose": pose}
    if reads_images or has_pilot:
        shape = image_shape(mount)
        focal = tuple(size / (2.0 * tan) for size, tan in zip(shape, tangents, strict=True))
        values |= {"image": shape, "focal_px": focal}
    if not reads_images:
        return from_mapping(parts.Camera, values, "camera"), None
    depth_filter = from_mapping(DepthFilterConfig, config["depth"]["filter"], "depth.filter")
    values["range_m"] = (depth_filter.near_m, depth_filter.far_m)
    return from_mapping(parts.Camera, values, "camera"), depth_filter


def _actions(config: Mapping[str, Any]) -> parts.Actions:
    profile = robot.SPEED_PROFILES[config["robot"]["profile"]]
    limits = {
        "low": robot.JOINT_LOWER,
        "zero": tuple(robot.STOWED[joint] for joint in robot.JOINTS),
        "high": robot.JOINT_UPPER,
    }
    if "manipulation" not in config["task"]:
        forward = (profile.forward_max, profile.reverse_max)
        return parts.Actions(parts.ABSOLUTE, forward, profile.turn_max, **limits)
    moves = from_mapping(ManipulationConfig, config["task"]["manipulation"], "task.manipulation").increments
    return parts.Actions(
        parts.INCREMENTS,
        (moves.forward_speed, moves.forward_speed),
        moves.turn_speed,
        **limits,
        joint_rate=moves.joint_rate,
        joint_lead=moves.joint_lead,
        gripper_middle=moves.gripper_middle,
        gripper_span=moves.gripper_span,
    )


def _profile(name: str) -> parts.Profile:
    profile = robot.SPEED_PROFILES[name]
    return parts.Profile(name=name, turn_acceleration=profile.turn_acceleration, **vars(profile))


def _training(metadata: Mapping[str, Any], task: Mapping[str, Any]) -> dict[str, Any]:
    dynamics = task.get("dynamics") or {}
    return {
        **metadata.get("facts", {}),
        "env_steps": metadata["env_steps"],
        "minutes": round(metadata["minutes"], 1),
        "dynamics": {name: dynamics[name] for name in _DYNAMICS if name in dynamics},
        "noise": task.get("noise") or {},
    }


def _card(name: str) -> str:
    """Return the model card beside a policy's file, empty if there is none."""
    card = find_policy(name).with_suffix(".md")
    return card.read_text(encoding="utf-8") if card.is_file() else ""
