"""Checks of a runner's configuration before anything is built."""

from __future__ import annotations

import inspect
import math
from collections.abc import Collection, Mapping
from typing import Any

from rsl_rl.modules.distribution import Distribution
from rsl_rl.utils import resolve_callable

from spin_rl.config import from_mapping
from spin_rl.models import DepthEncoderConfig, ScandotModel
from spin_rl.runners.ppo.algorithm import PPO, SCHEDULES

KEYS = {"class_name", "seed", "num_steps_per_env", "save_interval", "save_minutes", "obs_groups", "algorithm"}
"""Settings of every runner, beside a section for each of its models."""
OPTIONAL_KEYS = {"class_name", "seed", "save_minutes"}
MODEL_ARGUMENTS = ("obs", "obs_groups", "obs_set", "output_dim")
"""Arguments of a model that are not settings."""
_POSITIVE_INTEGERS = ("num_learning_epochs", "num_mini_batches")
_POSITIVE_NUMBERS = (
    "clip_param",
    "learning_rate",
    "min_learning_rate",
    "max_learning_rate",
    "max_grad_norm",
    "desired_kl",
)
_FRACTIONS = ("gamma", "lam", "imitation_anneal")
_WEIGHTS = ("task_reward", "imitation_reward", "imitation_loss", "latent_loss")


def check_config(cfg: Mapping[str, Any], observed: Collection[str], num_envs: int) -> None:
    """Check a runner's configuration against the classes that it names and against the environment.

    Args:
        cfg: Configuration of `PPORunner`.
        observed: Names of the environment's observation groups.
        num_envs: Number of environments.

    Raises:
        ValueError: A key is unknown or missing, or a value is impossible; one line that names the key.
    """
    check_loop(cfg, observed, ("actor", "critic"))
    distribution = cfg["actor"].get("distribution_cfg")
    _require(
        distribution is not None, "actor.distribution_cfg", "given: a policy has to explore", distribution
    )
    check_class(distribution, Distribution, "actor.distribution_cfg", given=("output_dim",))
    _require(not cfg["critic"].get("distribution_cfg"), "critic.distribution_cfg", "none", "one")
    check_class(
        cfg["algorithm"], PPO, "algorithm", given=("actor", "critic", "storage", "device", "multi_gpu_cfg")
    )
    check_learning(cfg["algorithm"], SCHEDULES, num_envs)


def check_loop(
    cfg: Mapping[str, Any], observed: Collection[str], models: tuple[str, ...], sections: tuple[str, ...] = ()
) -> None:
    """Check what the configurations of all runners have in common.

    Args:
        cfg: Configuration of the runner.
        observed: Names of the environment's observation groups.
        models: Sections that describe models.
        sections: Further sections that there may be.

    Raises:
        ValueError: A key is unknown or missing, or a value is impossible; one line that names the key.
    """
    required = KEYS - OPTIONAL_KEYS | set(models)
    _check_keys(cfg, KEYS | required | set(sections), required, "runner")
    for key in ("num_steps_per_env", "save_interval"):
        _require(_is_positive_integer(cfg[key]), f"runner.{key}", "a positive integer", cfg[key])
    minutes = cfg.get("save_minutes")
    _require(
        minutes is None or _is_positive(minutes), "runner.save_minutes", "a positive number or none", minutes
    )
    _require(isinstance(cfg.get("seed", 0), int), "runner.seed", "an integer", cfg.get("seed"))
    _check_groups(cfg["obs_groups"], observed, models)
    for name in models:
        check_class(cfg[name], ScandotModel, name, MODEL_ARGUMENTS)
        from_mapping(DepthEncoderConfig, cfg[name].get("depth_encoder") or {}, "depth_encoder")


def check_learning(cfg: Mapping[str, Any], schedules: tuple[str, ...], num_envs: int) -> None:
    """Check the numbers of an algorithm's section.

    Args:
        cfg: The section.
        schedules: Schedules of the learning rate that it knows.
        num_envs: Number of environments.

    Raises:
        ValueError: A value is impossible; one line that names the key.
    """
    for key in _POSITIVE_INTEGERS:
        _require(
            _is_positive_integer(cfg.get(key, 1)), f"algorithm.{key}", "a positive integer", cfg.get(key)
        )
    for key in _POSITIVE_NUMBERS:
        _require(_is_positive(cfg.get(key, 1.0)), f"algorithm.{key}", "a positive number", cfg.get(key))
    for key in _FRACTIONS:
        value = cfg.get(key, 1.0)
        _require(_is_positive(value) and value <= 1.0, f"algorithm.{key}", "above 0 and at most 1", value)
    for key in _WEIGHTS:
        value = cfg.get(key, 0.0)
        _require(value == 0.0 or _is_positive(value), f"algorithm.{key}", "zero or a positive number", value)
    schedule = cfg.get("schedule", schedules[0])
    _require(schedule in schedules, "algorithm.schedule", f"one of {', '.join(schedules)}", schedule)
    batches = cfg.get("num_mini_batches", 4)
    _require(
        batches <= num_envs, "algorithm.num_mini_batches", f"at most the {num_envs} environments", batches
    )


def _check_groups(groups: Mapping[str, Any], observed: Collection[str], models: tuple[str, ...]) -> None:
    _check_keys(groups, set(models), set(models), "obs_groups")
    for name, members in groups.items():
        _require(bool(members), f"obs_groups.{name}", "a list of observation groups", members)
        for group in members:
            _require(group in observed, f"obs_groups.{name}", f"of {', '.join(observed)}", group)


def check_class(cfg: Mapping[str, Any], base: type, where: str, given: tuple[str, ...]) -> None:
    """Check that a section names a class of some kind and only arguments of its constructor.

    Args:
        cfg: `class_name` and arguments.
        base: Class of which the named one is a kind.
        where: Name of the section, for the message.
        given: Arguments that the program fills in.

    Raises:
        ValueError: It does not; one line that names the key.
    """
    _require("class_name" in cfg, f"{where}.class_name", "given", None)
    try:
        named = resolve_callable(cfg["class_name"])
    except (AttributeError, ImportError, ValueError) as error:
        raise ValueError(f"{where}.class_name: there is no '{cfg['class_name']}'.") from error
    is_fit = inspect.isclass(named) and issubclass(named, base)
    _require(is_fit, f"{where}.class_name", f"a {base.__module__}.{base.__name__}", cfg["class_name"])
    assert inspect.isclass(named)
    _check_keys(cfg, (_arguments(named) - set(given)) | {"class_name"}, set(), where)


def _arguments(named: type) -> set[str]:
    """Names of a constructor's arguments; one that hands any others on has its base class's too."""
    parameters = inspect.signature(named.__init__).parameters.values()
    names = {p.name for p in parameters if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)} - {"self"}
    hands_on = any(p.kind is p.VAR_KEYWORD for p in parameters)
    return names | _arguments(named.__mro__[1]) if hands_on else names


def _check_keys(cfg: Mapping[str, Any], known: set[str], required: set[str], where: str) -> None:
    for key in cfg:
        if key not in known:
            raise ValueError(f"{where}.{key} is not a setting; known are {', '.join(sorted(known))}.")
    for key in sorted(required):
        if key not in cfg:
            raise ValueError(f"{where}.{key} is missing.")


def _require(fine: bool, key: str, wanted: str, value: Any) -> None:
    if not fine:
        raise ValueError(f"{key} must be {wanted}, not {value!r}.")


def _is_positive(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0.0 < value < math.inf


def _is_positive_integer(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value > 0
