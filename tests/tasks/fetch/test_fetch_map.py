"""A policy that drives by a map, in a whole fetch."""

import pytest
import torch
from fetch_worlds import CARRY, REACH, enter

from spin_rl.benchmark import settings
from spin_rl.config import ConfigError
from spin_rl.sensors.noisy_map import MapConfig
from spin_rl.tasks.common.proprioception import camera_columns
from spin_rl.tasks.fetch.config import FetchConfig
from spin_rl.tasks.fetch.policy import FetchPolicy
from spin_rl.tasks.nav.config import NavConfig

NAV = {
    "robot": {"profile": "paper"},
    "task": {"map": {"enabled": True, "errors": "mixture"}, "camera_pose": [0.0, -0.6]},
}
PICK = {"robot": {"profile": "paper"}, "task": {"camera_pose": None}}


@pytest.mark.parametrize("stage", [REACH, CARRY])
def test_an_exact_map_tells_what_is_there(make_fetch_env, stage):
    env = make_fetch_env(FetchConfig(map=MapConfig(enabled=True, errors="none")), num_envs=3, seed=3)
    for world in range(3):
        enter(env, stage, world)
    obs = env.step(torch.zeros(3, 10, device=env.device))[0]
    torch.testing.assert_close(obs["scandots_map"], obs["scandots_all"])
    assert obs["scandots_map"].any()


def test_a_map_with_errors_does_not_and_neither_need_tell_of_the_table(make_fetch_env):
    cfg = FetchConfig(map=MapConfig(enabled=True, errors="large"), tell_table=False)
    env = make_fetch_env(cfg, num_envs=3, seed=3)
    obs = env.step(torch.zeros(3, 10, device=env.device))[0]
    assert obs["scandots_map"].shape == obs["scandots_all"].shape
    assert obs["scandots_map"].shape[1] == 32 * (cfg.scene.pool.num_slots - 1)
    off = (obs["scandots_map"] - obs["scandots_all"]).abs()
    assert 0.01 < off.max() < 3.0


def test_a_fetch_takes_over_the_map_and_not_the_pose_of_a_camera_that_saw_nothing():
    task = settings.of_fetch(NAV, PICK)["task"]
    assert task["map"] == NAV["task"]["map"] and "camera_pose" not in task
    free = NAV | {"task": NAV["task"] | {"camera_pose": None}}
    assert settings.of_fetch(free, PICK)["task"]["map"]["enabled"] and settings.told_pose(free) is None
    seeing = NAV | {"task": NAV["task"] | {"map": {"enabled": False, "errors": "mixture"}}}
    with pytest.raises(ConfigError, match=r"^pick: task\.camera_pose is None there and"):
        settings.of_fetch(seeing, PICK)


class Told:
    """Notes what it is told."""

    def __init__(self):
        self.proprio = None

    def __call__(self, obs):
        self.proprio = obs["proprio"].clone()
        return torch.zeros(len(self.proprio), 10)

    def reset(self, dones=None):
        pass


def test_it_is_told_that_its_camera_stands_where_it_stood(make_fetch_env, make_nav_env):
    """Against what an environment says whose camera does stand there."""
    pose, nav, pick = (0.3, -0.6), Told(), Told()
    held = make_nav_env(NavConfig(camera_pose=pose), num_envs=2, seed=1)
    for _ in range(15):
        obs = held.step(torch.zeros(2, 10, device=held.device))[0]
    env = make_fetch_env(num_envs=2, seed=3)
    policy = FetchPolicy(nav, pick, pose)
    before = env.step(torch.full((2, 10), 0.3, device=env.device))[0]
    policy(before)
    columns = list(camera_columns()["proprio"])
    torch.testing.assert_close(nav.proprio[:, columns], obs["proprio"][:, columns], atol=5e-3, rtol=0)
    others = [column for column in range(31) if column not in columns]
    assert torch.equal(nav.proprio[:, others], before["proprio"][:, others])
    assert torch.equal(pick.proprio, before["proprio"])
