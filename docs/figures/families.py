"""Draw docs/figures/families.png: a generated scene of every family, and three of the example scenes.

Run from the repository root: ``python docs/figures/families.py``.
"""

from __future__ import annotations

from pathlib import Path

from scenes import draw, example, save_sheet

import spin_rl
from spin_rl.scenes.kinds import FAMILIES
from spin_rl.scenes.layout import Scene
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.env import NavEnv

SEEDS = {"corridor": 6, "room": 6, "doorway": 1, "field": 5, "crossing": 2, "open": 4}
"""Seed of each family's picture, picked by eye so that it shows what is typical."""

EXAMPLES = ("lab", "office", "cafe")


def generated(family: str, seed: int) -> Scene:
    """A scene of a family as `spin-eval benchmark=rooms` would draw it from this seed."""
    cfg = spin_rl.evaluation_config("nav", ["scene=mixture"])
    assert isinstance(cfg, NavConfig)
    env = NavEnv(cfg, 1, "cpu", seed, capture=False)
    env.set_families([FAMILIES.index(family)])
    env.reset()
    return env.sim.layout.scene(0)


def main() -> None:
    """Write the picture beside this file."""
    pictures = [draw(family, generated(family, seed)) for family, seed in SEEDS.items()]
    pictures += [draw(f"{name}.yaml", example(name)) for name in EXAMPLES]
    save_sheet(pictures, Path(__file__).with_suffix(".png"))


if __name__ == "__main__":
    main()
