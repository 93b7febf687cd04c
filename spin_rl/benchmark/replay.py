"""One corridor of the reach benchmark again: found by seed and world, played alone."""

from __future__ import annotations

from spin_rl.benchmark.reach import Cell
from spin_rl.benchmark.rounds import SEED_OFFSET
from spin_rl.scenes.kinds import DIFFICULTIES
from spin_rl.scenes.layout import Scene
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.env import NavEnv


def benchmark_scene(cfg: NavConfig, cell: Cell, seed: int, world: int, device: str) -> Scene:
    """Return the corridor, start and goal of a world's first episode in the benchmark's batch of a seed.

    It depends on the cell, the seed and the world's index, not on the number of worlds. Which cell a world
    had does depend on it, so the cell is given too.

    Args:
        cfg: Task configuration of the evaluation.
        cell: The world's cell.
        seed: One of the evaluation's seeds.
        world: Index of the world in the batch.
        device: "cpu" or "cuda:N".
    """
    env = NavEnv(cfg, world + 1, device, capture=False)
    count = env.num_envs
    env.set_cells([int(cell.scenario)] * count, [DIFFICULTIES.index(cell.difficulty)] * count)
    env.reseed(SEED_OFFSET + seed)
    env.reset()
    return env.sim.layout.scene(world)
