"""Options and fixtures that all tests share."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:  # tests/deploy also runs where neither Torch nor Warp is installed
    from spin_rl.tasks.nav.config import NavConfig
    from spin_rl.tasks.nav.env import NavEnv

NUM_WORLDS = 8


def pytest_addoption(parser):
    parser.addoption("--device", default="cpu", help="device for kernels and environments: cpu or cuda:0")


@pytest.fixture(scope="session")
def device(request) -> str:
    """The Warp and Torch device under test."""
    import warp as wp

    name = request.config.getoption("--device")
    wp.init()
    wp.get_device(name)  # fails here, by name, where the machine lacks it
    return name


@pytest.fixture(scope="session")
def make_nav_env(device):
    """Makes small navigation environments.

    Kernels are compiled once for all of them, as long as they share the solver's options and the pool.
    """
    from spin_rl.tasks.nav.config import NavConfig
    from spin_rl.tasks.nav.env import NavEnv

    def make(cfg: NavConfig | None = None, num_envs: int = NUM_WORLDS, seed: int = 0, **options) -> NavEnv:
        return NavEnv(cfg or NavConfig(), num_envs, device, seed, **options)

    return make


@pytest.fixture(scope="session")
def shared_nav_env(make_nav_env) -> NavEnv:
    return make_nav_env(seed=3)


@pytest.fixture
def nav_env(shared_nav_env) -> NavEnv:
    """The default task in 8 worlds, at the first episodes of seed 3; a test may do anything to it."""
    env = shared_nav_env
    env.set_cells([0] * NUM_WORLDS, [-1] * NUM_WORLDS)
    env.reseed(3)
    env.reset()
    env.episode_stats()
    return env
