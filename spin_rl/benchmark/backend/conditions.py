"""Conditions of a benchmark that another simulator, or an exported policy, does not have."""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import Any

from spin_rl.config import ConfigError
from spin_rl.deploy.agent import Agent
from spin_rl.deploy.backends.handled import SIGHT_M
from spin_rl.deploy.contract import Contract
from spin_rl.deploy.fetch.agent import FetchAgent
from spin_rl.sensors.depth.noise import DepthNoiseConfig
from spin_rl.tasks.fetch.config import FetchConfig
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.pick.config import PickConfig

Config = NavConfig | PickConfig | FetchConfig
"""Of the tasks whose episodes can be run again."""


def pilot_of(cfg: Config) -> dict[str, Any]:
    """Return the sections of a task that its pilot is exported with, see `export.describe`."""
    return {"guard": asdict(cfg.guard), "planner": asdict(cfg.planner)} if isinstance(cfg, NavConfig) else {}


def check(agent: Agent | FetchAgent, cfg: Config) -> None:
    """Reject conditions that C MuJoCo, or what was exported, does not have.

    Args:
        agent: What was exported.
        cfg: Configuration of the batched benchmark.

    Raises:
        ConfigError: One line that names the key.
    """
    if cfg.depth is not None and cfg.depth.noise != DepthNoiseConfig():
        raise ConfigError("depth: images of the other simulator are exact, as with depth=ideal")
    noisy = [name for name, value in vars(cfg.noise).items() if value]
    if noisy:
        raise ConfigError(f"task.noise.{noisy[0]}: the other simulator measures exactly, say 0")
    if not isinstance(cfg, NavConfig) and cfg.detector != "none":
        raise ConfigError("task.detector: the other simulator tells where the object is, say none")
    for key, (asked, exported) in _pairs(agent, cfg).items():
        if asked != exported:
            raise ConfigError(f"{key}: is {asked}, and {exported} in the exported policy")
    for key, (asked, there) in _of_the_simulator(agent.contract, cfg).items():
        if asked != there:
            raise ConfigError(f"{key}: is {asked}, and {there} in the other simulator")


def _pairs(agent: Agent | FetchAgent, cfg: Config) -> dict[str, tuple[Any, Any]]:
    """Return what the benchmark has, and what the policies were exported with, by its key."""
    contract = agent.contract
    pairs: dict[str, tuple[Any, Any]] = {
        "task.camera_pose": (cfg.camera_pose, contract.camera.pose),
        "task.camera_mount": (cfg.camera_mount, contract.camera.mount),
        "robot.profile": (cfg.robot_profile, contract.speed_profile.name),
    }
    if contract.depth_filter is not None and cfg.depth is not None:
        pairs["depth.filter"] = cfg.depth.filter, contract.depth_filter
    if isinstance(cfg, PickConfig):
        return pairs
    told = contract.goal
    pairs["task.goal_range_m"] = cfg.goal_range_m, None if told is None else told.range_m
    if contract.scandots is not None:
        pairs["task.scandots"] = asdict(cfg.scandots), asdict(contract.scandots)
    if isinstance(cfg, NavConfig):
        pairs["task.goal_tolerance_m"] = cfg.goal_tolerance_m, None if told is None else told.tolerance_m
        guard = _if_enabled(cfg.guard)
        if guard is not None:
            del guard["foresee_s"]  # the pilot does not expect things to go on moving
        pairs["task.guard"] = guard, _if_enabled(contract.guard)
        pairs["task.planner"] = _if_enabled(cfg.planner), _if_enabled(contract.planner)
    elif isinstance(agent, FetchAgent):
        asked = asdict(cfg)
        pairs |= {
            f"task.{field.name}": (asked[field.name], getattr(agent.rules, field.name))
            for field in fields(agent.rules)
        }
    return pairs


def _of_the_simulator(contract: Contract, cfg: Config) -> dict[str, tuple[Any, Any]]:
    """Return what the benchmark has, and what the other simulator is, by its key."""
    profile, dynamics = contract.speed_profile, cfg.dynamics
    nominal = {
        "base_lag_s": profile.base_time_constant,
        "joint_lag_s": profile.joint_time_constant,
        "speed_scale": 1.0,
        "acceleration_scale": 1.0,
    }
    pairs: dict[str, tuple[Any, Any]] = {
        f"task.dynamics.{name}": (getattr(dynamics, name), (value, value)) for name, value in nominal.items()
    }
    if not isinstance(cfg, NavConfig):
        pairs["task.sight"] = (cfg.sight.near_m, cfg.sight.far_m, cfg.sight.occlusion), (*SIGHT_M, True)
    return pairs


def _if_enabled(section: Any) -> dict[str, Any] | None:
    return asdict(section) if section is not None and section.enabled else None
