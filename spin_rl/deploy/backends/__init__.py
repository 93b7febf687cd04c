"""Robots to run on: each a module with `open_robot`, imported when it is asked for.

`open_robot(settings, contract)` takes the settings `robot.<key>=<value>` of the command line as a mapping,
and the policy's contract, and returns a `Robot`.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any

from spin_rl.config import ConfigError
from spin_rl.deploy.contract import Contract
from spin_rl.deploy.interface import Robot

BACKENDS = {name: f"{__name__}.{name}" for name in ("mujoco", "stretch", "ros2")}
"""Module of every back end by its name."""


def open_backend(name: str, settings: Mapping[str, Any], contract: Contract) -> Robot:
    """Open a back end, one of `BACKENDS` or a module of yours; nothing is connected yet.

    Raises:
        ConfigError: There is none, one of its packages is missing, or a setting is wrong.
    """
    path = BACKENDS.get(name, name)
    unknown = ConfigError(f"backend: unknown {name!r}; choose from {', '.join(BACKENDS)}, or name a module")
    if path.startswith("."):  # relative to nothing
        raise unknown
    try:
        module = importlib.import_module(path)
    except ModuleNotFoundError as error:
        if error.name == path:
            raise unknown from None
        raise ConfigError(f"backend: {name} needs a package that is not installed: {error}") from None
    except ImportError as error:
        raise ConfigError(f"backend: {name} needs a package that is not installed: {error}") from None
    if not hasattr(module, "open_robot"):
        raise ConfigError(f"backend: the module {name} has no open_robot")
    try:
        return module.open_robot(settings, contract)
    except ImportError as error:  # of a library that only this back end needs
        raise ConfigError(f"backend: {name} needs a package that is not installed: {error}") from None
