"""The configuration of an evaluation: conf/eval.yaml, with the body and inputs that the policy knows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from typing import Any

import hydra
from hydra.core.global_hydra import GlobalHydra
from omegaconf import DictConfig, OmegaConf

from spin_rl.paths import CONF_DIR


def compose(overrides: Sequence[str] = ()) -> DictConfig:
    """Compose conf/eval.yaml, also inside another command's run."""
    running = GlobalHydra.instance().is_initialized()  # commands here all search the same folder
    with nullcontext() if running else hydra.initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        return hydra.compose("eval", list(overrides))


def for_policy(cfg: DictConfig, trained: Mapping[str, Any] | None, overridden: Sequence[str]) -> DictConfig:
    """Take over what a policy was trained with, except for what the user asked for.

    Args:
        cfg: Composed conf/eval.yaml.
        trained: Configuration of the policy's training, nested; None or empty changes nothing.
        overridden: Overrides of the command line, such as `robot=re1` or `task.camera_mount=landscape`.

    Returns:
        A new configuration.
    """
    result = cfg.copy()
    asked = {override.lstrip("+~").partition("=")[0] for override in overridden}
    source = OmegaConf.create(dict(trained or {}))
    # What defines a policy's body and inputs; everything else is the benchmark's.
    keys = ["robot.profile", "task.camera_mount", "task.camera_pose"]
    for section in ("task.scandots", "task.depth", "depth.filter"):
        keys += [f"{section}.{name}" for name in OmegaConf.select(source, section) or ()]
    for key in keys:
        value = OmegaConf.select(source, key)
        by_user = ({key, key.rpartition(".")[0], key.partition(".")[0]} - {"task"}) & asked
        if value is not None and not by_user:
            OmegaConf.update(result, key, value, force_add=True)
    return result


def scene_label(choice: str, overridden: Sequence[str]) -> str | None:
    """Name the distribution of corridors, None for the benchmark's own.

    Args:
        choice: Name in conf/scene.
        overridden: Overrides of the command line; those of single values are part of the name.
    """
    changes = [override for override in overridden if override.lstrip("+~").startswith("scene.")]
    return None if choice == "nav" and not changes else ", ".join([choice, *changes])
