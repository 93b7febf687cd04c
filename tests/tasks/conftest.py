"""Fixtures of the tasks' tests."""

import pytest

from spin_rl.tasks.fetch.config import FetchConfig
from spin_rl.tasks.fetch.env import FetchEnv
from spin_rl.tasks.pick.config import PickConfig
from spin_rl.tasks.pick.env import PickEnv

NUM_WORLDS = 8


@pytest.fixture(scope="session")
def make_pick_env(device):
    """Makes small pick environments; kernels are compiled once for all with the same solver options."""

    def make(cfg: PickConfig | None = None, num_envs: int = NUM_WORLDS, seed: int = 0, **options) -> PickEnv:
        return PickEnv(cfg or PickConfig(), num_envs, device, seed, **options)

    return make


@pytest.fixture(scope="session")
def shared_pick_env(make_pick_env) -> PickEnv:
    return make_pick_env(seed=3)


@pytest.fixture
def pick_env(shared_pick_env) -> PickEnv:
    """The default task in 8 worlds, at the first episodes of seed 3; a test may do anything to it."""
    env = shared_pick_env
    env.set_objects(["any"] * NUM_WORLDS)
    env.reseed(3)
    env.reset()
    env.episode_stats()
    return env


@pytest.fixture(scope="session")
def make_fetch_env(device):
    """Makes small fetch environments; kernels are compiled once for all with the same solver options."""

    def make(cfg: FetchConfig | None = None, num_envs: int = 4, seed: int = 0, **options) -> FetchEnv:
        return FetchEnv(cfg or FetchConfig(), num_envs, device, seed, **options)

    return make
