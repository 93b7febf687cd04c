"""One scene of the benchmarks of reach and rooms again: found by seed and world, played alone."""

from __future__ import annotations

from spin_rl.benchmark.reach import Cell
from spin_rl.benchmark.rounds import SEED_OFFSET
from spin_rl.scenes.kinds import DIFFICULTIES, FAMILIES
from spin_rl.scenes.layout import Scene
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.env import NavEnv


def benchmark_scene(cfg: NavConfig, condition: Cell | str, seed: int, world: int, device: str) -> Scene:
    """Return the scene, start and goal of a world's first episode in a benchmark's batch of a seed.

    It depends on the condition, the seed and the world's index, not on the number of worlds. Which condition
    a world had does depend on it, so it is given too.

    Args:
        cfg: Task configuration of the evaluation.
        condition: The world's cell, or the name of its family.
        seed: One of the evaluation's seeds.
        world: Index of the world in the batch.
        device: "cpu" or "cuda:N".
    """
    env = NavEnv(cfg, world + 1, device, capture=False)
    count = env.num_envs
    if isinstance(condition, Cell):
        env.set_cells([int(condition.scenario)] * count, [DIFFICULTIES.index(condition.difficulty)] * count)
    else:
        env.set_families([FAMILIES.index(condition)] * count)
    env.reseed(SEED_OFFSET + seed)
    env.reset()
    return env.sim.layout.scene(world)
