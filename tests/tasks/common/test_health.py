"""Physics that went wrong: non-finite worlds and dropped contacts."""

import numpy as np
import pytest
import torch
from nav_worlds import actions, assert_same, run

from spin_rl.sim.config import SimConfig
from spin_rl.sim.simulation import OVERFLOWS
from spin_rl.tasks.common import episode
from spin_rl.tasks.nav import rewards
from spin_rl.tasks.nav.config import NavConfig

SICK = 2
ALL_TERMS = NavConfig(reward=dict.fromkeys(rewards.TERMS, 1.0))


@pytest.mark.parametrize("state", ["qvel", "qpos", "action"])
def test_non_finite_world_is_reset_alone(make_nav_env, tmp_path, state):
    env, twin = make_nav_env(ALL_TERMS, 4), make_nav_env(ALL_TERMS, 4)
    others = [w for w in range(4) if w != SICK]
    sequence = actions(10, 4)
    assert_same(run(env, sequence[:3]), run(twin, sequence[:3]))
    env.level.fill_(0.5)
    sick = sequence[3].clone()
    if state == "action":
        sick[SICK, 4] = torch.nan
    else:
        getattr(env.sim.views, state)[SICK, 5] = torch.nan if state == "qvel" else torch.inf

    broken, healthy = run(env, sick[None]), run(twin, sequence[3:4])
    assert_same(broken, healthy, others)
    assert env.outcome.tolist() == [episode.NON_FINITE if w == SICK else episode.RUNNING for w in range(4)]
    assert broken[0]["done"].tolist() == [int(w == SICK) for w in range(4)]
    assert all(np.isfinite(value).all() for value in broken[0].values())
    assert env.episode_length_buf[SICK] == 0
    np.testing.assert_array_equal(broken[0]["qpos"][SICK, :3], env.sim.layout.start.numpy()[SICK])
    assert env.level.tolist() == pytest.approx([0.5, 0.5, 0.45, 0.5])

    (file,) = env.dump_non_finite(tmp_path / "non_finite")
    assert file.parent == tmp_path / "non_finite"
    with np.load(file) as record:
        assert record["qpos"].shape == record["qvel"].shape == (8, 13) and record["action"].shape == (8, 10)
        rows = np.concatenate([record[name] for name in ("qpos", "qvel", "action")], axis=1)
    assert np.isfinite(rows[:-1]).all() and not np.isfinite(rows[-1]).all()
    # Three steps of this episode came before; older rows are empty.
    assert (rows[:4] == 0).all() and (np.abs(rows[4:7]).sum(axis=1) > 0).all()
    assert env.dump_non_finite(tmp_path) == []

    after = run(env, sequence[4:])
    assert_same(after, run(twin, sequence[4:]), others)
    assert all(np.isfinite(value).all() for step in after for value in step.values())
    stats = env.episode_stats()
    assert stats["non_finite_rate"] * stats["episodes"] == pytest.approx(1.0)


@pytest.mark.parametrize(("state", "value"), [("qpos", 1e30), ("qpos", -2e4), ("qvel", 1e30)])
def test_a_world_that_bursts_without_infinities_is_reset_too(make_nav_env, state, value):
    env = make_nav_env(ALL_TERMS, 4)
    getattr(env.sim.views, state)[SICK, 10] = value
    (step,) = run(env, actions(1, 4))
    assert env.outcome[SICK] == episode.NON_FINITE
    assert all(np.abs(numbers).max() < 1e4 for numbers in step.values())


def test_a_disk_that_is_full_of_dumps_costs_no_training(make_nav_env, monkeypatch, tmp_path, capfd):
    def refuse(*_, **__):
        raise OSError(28, "No space left on device")

    env = make_nav_env(num_envs=2)
    env.sim.views.qvel[:] = torch.nan
    env.step(env.sim.views.action.clone())
    monkeypatch.setattr(np, "savez_compressed", refuse)
    assert env.dump_non_finite(tmp_path) == []
    assert "No space left on device" in capfd.readouterr().err


def test_more_non_finite_worlds_than_dumps(make_nav_env, tmp_path):
    env = make_nav_env(num_envs=12)
    env.sim.views.qvel[:] = torch.nan
    env.step(env.sim.views.action.clone())
    assert (env.outcome == episode.NON_FINITE).all()
    assert len(env.dump_non_finite(tmp_path)) == 8
    assert env.episode_stats()["non_finite_rate"] == 1.0


def crash(env, steps):
    """Drive everywhere with the arm out and stay in contact; return whether all numbers stayed finite."""
    drive = torch.zeros(env.num_envs, 10, device=env.device)
    drive[:, 0], drive[:, 1], drive[:, 3] = 1.0, 0.5, 1.0
    return all(np.isfinite(value).all() for step in run(env, [drive] * steps) for value in step.values())


@pytest.mark.parametrize(
    ("key", "small", "causes"),
    [("contacts_per_world", 1, {"broadphase", "narrowphase"}), ("constraints_per_world", 2, {"njmax"})],
)
def test_overflow_is_counted_by_cause_and_survived(make_nav_env, key, small, causes):
    cfg = NavConfig(sim=SimConfig(**{key: small}), stop_on_collision=False)
    env = make_nav_env(cfg, 4)
    assert crash(env, 30)
    counts = env.episode_stats()
    found = {name for name in OVERFLOWS if counts[f"overflow/{name}"] > 0}
    assert found == causes
    assert all(counts[f"overflow/{name}"] <= 30 * 4 for name in found)
    assert all(env.episode_stats()[f"overflow/{name}"] == 0 for name in OVERFLOWS)  # read once


def test_overflow_is_over_when_its_cause_is(make_nav_env):
    # mujoco_warp's bits stay set until a reset; a step without a dropped contact must not count.
    cfg = NavConfig(sim=SimConfig(constraints_per_world=2), stop_on_collision=False)
    env = make_nav_env(cfg, 4)
    assert crash(env, 30) and env.episode_stats()["overflow/njmax"] > 0
    env.sim.views.qpos[:, :2] += 100.0  # away from everything
    held = env.sim.views.action.clone()
    held[:] = 0.0
    env.step(held)
    env.episode_stats()
    for _ in range(5):
        env.step(held)
    assert env.episode_stats()["overflow/njmax"] == 0


def test_overflow_can_raise_and_names_the_key(make_nav_env):
    cfg = NavConfig(sim=SimConfig(contacts_per_world=1, overflow="raise"), stop_on_collision=False)
    env = make_nav_env(cfg, 4)
    env.episode_stats()
    crash(env, 30)
    with pytest.raises(RuntimeError, match=r"overflow/broadphase.*increase sim\.contacts_per_world, now 1"):
        env.episode_stats()


def test_default_pools_hold_what_happens(make_nav_env):
    env = make_nav_env(NavConfig(stop_on_collision=False, sim=SimConfig(overflow="raise")), 8)
    assert crash(env, 40)
    env.episode_stats()
