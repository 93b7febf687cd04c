"""Checks of a runner's configuration before anything is built.

What a setting of a model or an algorithm may be is said once: by the types of its constructor's arguments.
"""

from __future__ import annotations

import importlib
import inspect
import re
import sys
import typing
from collections.abc import Collection, Mapping
from typing import Annotated, Any

from rsl_rl.modules.distribution import Distribution
from rsl_rl.utils import resolve_callable

from spin_rl.config import Choice, Rising, check_value, from_mapping, short
from spin_rl.models import DepthEncoderConfig, ScandotModel
from spin_rl.models.settings import Deviation, DeviationRange
from spin_rl.ranges import Count, Minutes, NumSteps, Seed
from spin_rl.runners.ppo.algorithm import PPO

SETTINGS = {
    "class_name": str | None,
    "seed": Seed,
    "num_steps_per_env": NumSteps,
    "save_interval": Count,
    "save_minutes": Minutes | None,  # pyright: ignore[reportOperatorIssue] - a type, also as a value
    "wandb_project": str | None,
    "obs_groups": dict[str, tuple[str, ...]],
    "algorithm": dict[str, Any],
}
"""Settings of every runner, beside a section for each of its models."""
OPTIONAL_KEYS = {"class_name", "seed", "save_minutes", "wandb_project"}
MODEL_ARGUMENTS = ("obs", "obs_groups", "obs_set", "output_dim")
"""Arguments of a model that are not settings."""

_CLASS_NAME = re.compile(r"(spin_rl|rsl_rl)(\.\w+)*[:.]\w+|\w+")
"""Of our packages, or a name that rsl_rl looks up in its own: nothing else is imported for a file's sake."""
_OWN_CLASS = re.compile(r"(\w+(?:\.\w+)*):\w+")
"""Of a user's module, which has to be imported already."""
_OF_RSL_RL = {
    "init_std": Deviation,
    "std_range": DeviationRange,
    "action_range": Annotated[tuple[float, float], Rising()],
    "std_type": Annotated[str, Choice(("scalar", "log"))],
}
"""What arguments of rsl_rl's classes may be, which say less."""
_MOVED = {
    "spin_rl.runners.algorithm:PPO": "spin_rl.runners.ppo.algorithm:PPO",
    "spin_rl.runners.dvo:ImitationPPO": "spin_rl.runners.ppo.dvo:ImitationPPO",
    "spin_rl.runners.distillation:Distillation": "spin_rl.runners.distillation.algorithm:Distillation",
}
"""Where classes are that configurations of older runs name."""


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
    key = "distribution_cfg"
    _require(distribution is not None, f"runner.actor.{key}", "given: a policy has to explore", distribution)
    _require(not cfg["critic"].get(key), f"runner.critic.{key}", "none", "one")
    given = ("actor", "critic", "storage", "device", "multi_gpu_cfg")
    check_class(cfg["algorithm"], PPO, "runner.algorithm", given)
    check_learning(cfg["algorithm"], num_envs)


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
    check_value(dict[str, Any], cfg, "runner")
    hints = SETTINGS | dict.fromkeys(models, dict[str, Any]) | dict.fromkeys(sections, dict[str, Any] | None)
    _check_keys(cfg, set(hints), set(hints) - OPTIONAL_KEYS - set(sections), "runner")
    for key, value in cfg.items():
        check_value(hints[key], value, f"runner.{key}")
    _check_groups(cfg["obs_groups"], observed, models)
    for name in models:
        check_model(cfg[name], f"runner.{name}")


def check_model(cfg: Mapping[str, Any], where: str) -> None:
    """Check the section of a model.

    Args:
        cfg: `class_name` and arguments.
        where: Name of the section, for messages.

    Raises:
        ValueError: It is no model, or a value is impossible; one line that names the key.
    """
    check_class(cfg, ScandotModel, where, MODEL_ARGUMENTS)
    from_mapping(DepthEncoderConfig, cfg.get("depth_encoder") or {}, f"{where}.depth_encoder")
    if cfg.get("distribution_cfg") is not None:
        check_class(cfg["distribution_cfg"], Distribution, f"{where}.distribution_cfg", ("output_dim",))


def check_learning(cfg: Mapping[str, Any], num_envs: int) -> None:
    """Check what of an algorithm's section depends on others; `check_class` has checked each for itself.

    Args:
        cfg: The section.
        num_envs: Number of environments.

    Raises:
        ValueError: A value is impossible; one line that names the key.
    """
    batches = cfg.get("num_mini_batches", 4)
    _require(
        batches <= num_envs,
        "runner.algorithm.num_mini_batches",
        f"at most the {num_envs} environments",
        batches,
    )
    least, most = (cfg.get(f"{end}_learning_rate") for end in ("min", "max"))
    _require(
        least is None or most is None or least <= most,
        "runner.algorithm.min_learning_rate",
        f"at most max_learning_rate, {most}",
        least,
    )


def _check_groups(groups: Mapping[str, Any], observed: Collection[str], models: tuple[str, ...]) -> None:
    _check_keys(groups, set(models), set(models), "runner.obs_groups")
    for name, members in groups.items():
        key = f"runner.obs_groups.{name}"
        _require(bool(members), key, "a list of observation groups", members)
        for group in members:
            _require(group in observed, key, f"of {', '.join(observed)}", group)
        _require(len(set(members)) == len(members), key, "different groups", list(members))


def check_class(cfg: Mapping[str, Any], base: type, where: str, given: tuple[str, ...]) -> None:
    """Check that a section names a class of some kind, and arguments of its constructor that it takes.

    Args:
        cfg: `class_name` and arguments.
        base: Class of which the named one is a kind.
        where: Name of the section, for the message.
        given: Arguments that the program fills in.

    Raises:
        ValueError: It does not; one line that names the key.
    """
    check_value(dict[str, Any], cfg, where)
    _require("class_name" in cfg, f"{where}.class_name", "given", None)
    named = _named_class(cfg["class_name"], f"{where}.class_name")
    is_fit = inspect.isclass(named) and issubclass(named, base)
    _require(is_fit, f"{where}.class_name", f"a {base.__module__}.{base.__name__}", cfg["class_name"])
    hints, required = _arguments(named)
    _check_keys(cfg, (hints.keys() - set(given)) | {"class_name"}, required - set(given), where)
    for key, value in cfg.items():
        if key == "teacher":  # a policy's name stands for it; the algorithm itself opens it
            check_teacher_name(value)
        elif key != "class_name":
            check_value(hints[key], value, f"{where}.{key}")


def check_teacher_name(value: Any) -> None:
    """Reject what is no name of a policy.

    Raises:
        ValueError: It is none; one line that names the key.
    """
    if not isinstance(value, str) or not value:
        raise ValueError(f"teacher: expected the name or path of a policy, got {short(value)}.")


def import_own_classes(cfg: Any, where: str = "runner") -> None:
    """Import the modules that a user's own configuration names classes of; never call it with a file's.

    Args:
        cfg: Configuration of a runner, or a part of it.
        where: Its name, for the message.

    Raises:
        ValueError: There is no such module; one line that names the key.
    """
    for key, value in cfg.items() if isinstance(cfg, Mapping) else ():
        own = _OWN_CLASS.fullmatch(value) if key == "class_name" and isinstance(value, str) else None
        if own is not None:
            try:
                importlib.import_module(own[1])
            except ImportError as error:
                raise ValueError(f"{where}.{key}: {value}: {error}.") from error
        import_own_classes(value, f"{where}.{key}")


def _named_class(name: Any, where: str) -> Any:
    """Find what a configuration names, without importing other packages than ours and rsl_rl."""
    if inspect.isclass(name):
        return name
    own = _OWN_CLASS.fullmatch(name) if isinstance(name, str) else None
    fits = isinstance(name, str) and _CLASS_NAME.fullmatch(name) is not None
    fits = fits or (own is not None and own[1] in sys.modules)
    _require(fits, where, "a class of spin_rl or rsl_rl, or of a module that is imported", name)
    try:
        return resolve_callable(name)
    except (AttributeError, ImportError, ValueError) as error:
        moved = f" It is '{_MOVED[name]}' now." if name in _MOVED else ""
        raise ValueError(f"{where}: there is no '{name}'.{moved}") from error


def _arguments(named: type) -> tuple[dict[str, Any], set[str]]:
    """Types of a constructor's arguments by name, and which have no default.

    One that hands any others on has its base class's too.
    """
    parameters = inspect.signature(named.__init__).parameters.values()
    hints = typing.get_type_hints(named.__init__, include_extras=True)
    own = [p for p in parameters if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY) and p.name != "self"]
    is_foreign = named.__module__.startswith("rsl_rl")
    found = {
        p.name: _OF_RSL_RL[p.name] if is_foreign and p.name in _OF_RSL_RL else hints.get(p.name, Any)
        for p in own
    }
    required = {p.name for p in own if p.default is p.empty}
    if any(p.kind is p.VAR_KEYWORD for p in parameters):
        others, needed = _arguments(named.__mro__[1])
        return others | found, needed | required
    return found, required


def _check_keys(cfg: Mapping[str, Any], known: set[str], required: set[str], where: str) -> None:
    for key in cfg:
        if key not in known:
            raise ValueError(f"{where}.{key} is not a setting; known are {', '.join(sorted(known))}.")
    for key in sorted(required):
        if key not in cfg:
            raise ValueError(f"{where}.{key} is missing.")


def _require(fine: bool, key: str, wanted: str, value: Any) -> None:
    if not fine:
        raise ValueError(f"{key} must be {wanted}, not {short(value)}.")
