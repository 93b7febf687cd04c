"""Entry points of the installed commands: help is printed before anything slow is imported."""

from __future__ import annotations

import sys
from importlib import import_module

from spin_rl.cli import help_text

MODULES = {
    "train": "train",
    "distill": "distill",
    "eval": "evaluate",
    "play": "play",
    "bench": "bench",
    "list": "catalogue",
    "export": "export",
    "reproduce": "reproduce",
}
"""Name of each command after `spin-` -> its module beside this one."""


def train() -> None:
    """Run `spin-train`."""
    _start("train")


def distill() -> None:
    """Run `spin-distill`."""
    _start("distill")


def evaluate() -> None:
    """Run `spin-eval`."""
    _start("eval")


def play() -> None:
    """Run `spin-play`."""
    _start("play")


def bench() -> None:
    """Run `spin-bench`."""
    _start("bench")


def export() -> None:
    """Run `spin-export`."""
    _start("export")


def reproduce() -> None:
    """Run `spin-reproduce`."""
    _start("reproduce")


def list_() -> None:
    """Run `spin-list`."""
    _start("list")


def _start(name: str) -> None:
    if help_text.is_asked_for(sys.argv[1:]):
        print(help_text.of(name))
    else:
        import_module(f"spin_rl.cli.{MODULES[name]}").main()
