"""A step without forces against the same step with them."""

import numpy as np
import pytest
import torch

from spin_rl.tasks.common.compose import compose
from spin_rl.tasks.nav.env import NavEnv
from spin_rl.tasks.registry import find_task

STEPS = 40
WORLDS = 48


def configured(*overrides):
    return find_task("nav").configure(compose("train", ["scene=mixture", *overrides]))


@pytest.fixture(scope="module")
def drives(device):
    """What a drive by random set-points is with forces and without, until each world's first episode ends."""
    held = 2 * torch.rand(STEPS // 8, WORLDS, 10, generator=torch.Generator().manual_seed(3)) - 1
    actions = held.repeat_interleave(8, dim=0).to(device)
    return {sim: drive(configured(f"sim={sim}"), actions, device) for sim in ("fast", "kinematic")}


def drive(cfg, actions, device):
    env = NavEnv(cfg, WORLDS, device, seed=5)
    poses, velocities, ends, parts = [], [], [], []
    for action in actions:
        env.step(action)
        poses.append(env.final_qpos.cpu().numpy().copy())
        velocities.append(env.final_qvel.cpu().numpy().copy())
        ends.append(env.outcome.cpu().numpy().copy())
        parts.append(env.sim.views.part_contacts.cpu().numpy().copy())
    return {
        "poses": np.array(poses), "velocities": np.array(velocities), "ends": np.array(ends),
        "parts": np.array(parts),
    }  # fmt: skip


def test_free_motion_is_the_same(drives):
    """Up to the step before anything ends; where the hand rests on the base, forces would push it back."""
    running = (drives["fast"]["ends"] == 0) & (drives["kinematic"]["ends"] == 0)
    running = np.logical_and.accumulate(running, axis=0)
    assert running.mean() > 0.7
    for name, limit in (("poses", 0.02), ("velocities", 0.06)):
        difference = np.abs(drives["fast"][name] - drives["kinematic"][name])[running]
        base_and_camera = difference[:, [0, 1, 2, -2, -1]]
        assert base_and_camera.max() < limit
        assert np.quantile(difference, 0.97) < limit


def test_episodes_end_the_same_way(drives):
    first = {sim: np.argmax(drive["ends"] != 0, axis=0) for sim, drive in drives.items()}
    over = (drives["fast"]["ends"] != 0).any(axis=0)
    assert over.sum() > 10
    same = np.abs(first["fast"] - first["kinematic"])[over] <= 1
    assert same.mean() > 0.9
    worlds = np.flatnonzero(over)[same]
    ends = {sim: drives[sim]["ends"][first[sim][worlds], worlds] for sim in drives}
    np.testing.assert_array_equal(ends["fast"], ends["kinematic"])
    parts = {sim: drives[sim]["parts"][first[sim][worlds], worlds] for sim in drives}
    assert (parts["fast"] & parts["kinematic"]).any(-1).mean() > 0.9 * parts["fast"].any(-1).mean()


def test_what_needs_forces_is_refused(device):
    with pytest.raises(ValueError, match=r"reward\.clearance needs velocities"):
        NavEnv(configured("sim=kinematic", "reward=clearance"), 2, device)
    values = compose("train", ["task=pick", "sim=kinematic"])
    spec = find_task("pick")
    with pytest.raises(ValueError, match=r"sim\.kinematic: this task needs forces"):
        spec.make_env(spec.configure(values), 2, device, 0)
