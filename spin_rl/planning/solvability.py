"""How many generated scenes have a way through: one line per benchmark cell or per family.

Run ``python -m spin_rl.planning.solvability --layouts 1000``, for families with ``--scene mixture``. What
moves is looked at where it reaches farthest.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from typing import Any, cast

import hydra
import numpy as np
import warp as wp
from omegaconf import OmegaConf

from spin_rl.config import from_mapping
from spin_rl.paths import CONF_DIR
from spin_rl.planning.distance_field import DistanceField
from spin_rl.planning.lattice import find_path, reachable
from spin_rl.scenes.corridors.generator import generate_layouts
from spin_rl.scenes.corridors.params import GeneratorParams
from spin_rl.scenes.kinds import DIFFICULTIES, FAMILIES, SCENARIOS
from spin_rl.scenes.layout import Layout, PoolSpec, Scene
from spin_rl.scenes.rooms.generator import FamilyGenerator
from spin_rl.scenes.rooms.params import BLOCKED_M, FamilyParams, Shares, scene_class

CELLS = tuple((scenario, i) for scenario in SCENARIOS for i in range(len(DIFFICULTIES)))


def generate_scenes(
    count: int,
    scenario: int,
    difficulty: int,
    *,
    seed: int = 0,
    level: float = 1.0,
    params: GeneratorParams | None = None,
) -> list[Scene]:
    """Generate scenes of one benchmark cell on the host.

    Args:
        count: How many.
        scenario: 0 either, 1 straight, 2 L-shaped.
        difficulty: -1 any, 0 easy, 1 medium, 2 hard.
        seed: Random seed.
        level: Curriculum level in [0, 1].
        params: Distribution; the default one if None.
    """
    layout = Layout(count, PoolSpec(), "cpu")
    with wp.ScopedDevice("cpu"):
        generate_layouts(
            layout,
            params or GeneratorParams(),
            seed=wp.full(1, seed, dtype=wp.int32),
            counter=wp.zeros(count, dtype=wp.int32),
            mask=wp.full(count, True, dtype=bool),
            scenario_choice=wp.full(count, scenario, dtype=wp.int32),
            difficulty_choice=wp.full(count, difficulty, dtype=wp.int32),
            level=wp.full(count, level, dtype=float),
        )
    return layout.scenes()


def generate_family_scenes(count: int, params: FamilyParams, *, seed: int = 0) -> list[Scene]:
    """Generate scenes of families on the host."""
    layout = Layout(count, params.pool, "cpu")
    field = DistanceField(layout, "cpu", blocked_m=BLOCKED_M)
    with wp.ScopedDevice("cpu"):
        draw = {
            "seed": wp.full(1, seed, dtype=wp.int32),
            "counter": wp.zeros(count, dtype=wp.int32),
            "mask": wp.full(count, True, dtype=bool),
        }
        generator = FamilyGenerator(layout, params)
        generator.build(**draw)
        field.update(layout.goal, draw["mask"])
        generator.place_starts(field.field, **draw)
    return layout.scenes()


def scene_params(name: str) -> GeneratorParams:
    """Read conf/scene/<name>.yaml; one with shares gives `FamilyParams`.

    Raises:
        ConfigError: It has an unknown key or an impossible value.
    """
    with hydra.initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        values = hydra.compose(f"scene/{name}").scene
    plain = cast(dict[str, Any], OmegaConf.to_container(values))
    return from_mapping(scene_class(plain), plain, "scene")


def is_solvable(scene: Scene) -> bool:
    """Whether the planner finds a way from start to goal, and to the place before it, if there is one."""
    if scene.has_via:
        return bool(reachable(scene, np.stack([scene.via, scene.goal])).all())
    return find_path(scene) is not None


def groups(
    params: GeneratorParams, count: int, *, seed: int = 0, level: float = 1.0
) -> Iterator[tuple[str, list[Scene]]]:
    """Names and scenes of all cells of the benchmark, or of all families that are ever drawn."""
    if isinstance(params, FamilyParams):
        for family in FAMILIES:
            if getattr(params.shares, family) > 0.0:
                alone = replace(params, shares=Shares(**{name: float(name == family) for name in FAMILIES}))
                yield family, generate_family_scenes(count, alone, seed=seed)
        return
    for scenario, difficulty in CELLS:
        name = f"{scenario} {DIFFICULTIES[difficulty]}"
        yield name, generate_scenes(count, scenario, difficulty, seed=seed, level=level, params=params)


def main() -> None:
    """Print the share of solvable layouts for every cell or family."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--layouts", type=int, default=1000, help="layouts per cell or family")
    scenes = sorted(file.stem for file in (CONF_DIR / "scene").glob("*.yaml"))
    parser.add_argument("--scene", default="nav", choices=scenes, help="distribution in conf/scene")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--level", type=float, default=1.0, help="curriculum level of corridors in [0, 1]")
    parser.add_argument("--processes", type=int, default=1)
    args = parser.parse_args()
    if args.layouts < 1 or args.processes < 1 or not 0.0 <= args.level <= 1.0:
        parser.error("--layouts and --processes must be at least 1, --level in [0, 1]")
    print("scenes      layouts  solvable  share   unsolved (first 10)")
    params = scene_params(args.scene)
    with ProcessPoolExecutor(args.processes) as pool:
        for name, scenes in groups(params, args.layouts, seed=args.seed, level=args.level):
            solved = np.array(list(pool.map(is_solvable, scenes, chunksize=8)))
            print(
                f"{name:10s}  {len(solved):7d}  {solved.sum():8d}  {solved.mean():.4f}  "
                f"{np.flatnonzero(~solved)[:10].tolist()}",
                flush=True,
            )


if __name__ == "__main__":
    main()
