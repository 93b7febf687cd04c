"""Packages that only some commands need."""

from __future__ import annotations

import importlib
from types import ModuleType

from spin_rl.config import ConfigError


def require(module: str, package: str, extra: str, option: str) -> ModuleType:
    """Import a module of an optional package.

    Args:
        module: What to import, such as `imageio.v2`.
        package: What to install for it.
        extra: Extra of this project that contains the package.
        option: Option of the command that needs it.

    Raises:
        ConfigError: It is not installed; one line that says what to install.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ConfigError(
            f"{option}: needs {package}; install it with: pip install 'spin-rl[{extra}]' ({error})"
        ) from None
