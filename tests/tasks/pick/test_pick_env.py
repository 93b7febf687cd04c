"""Stepping and resetting the pick task: masks, graphs, seeds, a frozen camera, levels, statistics."""

import io

import numpy as np
import pytest
import torch
import warp as wp
from nav_worlds import actions, assert_same, run, snapshot

from spin_rl import robot
from spin_rl.scenes.objects.shapes import OBJECTS
from spin_rl.tasks.common import episode
from spin_rl.tasks.common.config import CurriculumConfig
from spin_rl.tasks.pick.config import PickConfig, PickNoise

NOISE = PickNoise(0.005, 0.02, 0.02, 0.01)
OBJECT_ARRAYS = ("kind", "start_pose", "half_extents", "mass", "friction", "near")


def pick_snapshot(env):
    """Everything that belongs to a world, one row per world."""
    state, forces = env.sim.object, env.sim.grasp
    values = snapshot(env) | {name: getattr(state, name).numpy().copy() for name in OBJECT_ARRAYS}
    values |= {"target": env.sim.target.numpy().copy(), "held": env._progress.held.numpy().copy()}
    for name in ("finger_force", "table_force", "hard_contact", "object_support"):
        values[name] = getattr(forces, name).numpy().copy()
    for name in ("body_mass", "body_inertia", "geom_friction", "geom_pos", "dof_invweight0"):
        values[name] = getattr(env.sim.model, name).numpy().copy()
    return values


def test_reset_leaves_the_neighbours_alone(pick_env, make_pick_env):
    sequence = actions(8, 8)
    twin = make_pick_env(seed=3)
    assert_same(run(pick_env, sequence[:4]), run(twin, sequence[:4]))
    for force in ("finger_force", "table_force", "hard_contact"):
        getattr(pick_env.sim.grasp.views, force)[:] = 5.0
    before = pick_snapshot(pick_env)
    chosen, others = [1, 4], [0, 2, 3, 5, 6, 7]
    with wp.ScopedDevice(pick_env.device):
        pick_env._launch_reset(wp.array(np.isin(np.arange(8), chosen), dtype=bool))
    after = pick_snapshot(pick_env)
    for name in before:
        np.testing.assert_array_equal(before[name][others], after[name][others], err_msg=name)
    for name in ("start_pose", "half_extents", "mass", "qpos"):
        assert (before[name][chosen] != after[name][chosen]).any(-1).all(), name
    assert (after["qvel"][chosen] == 0).all() and (after["episode_length"][chosen] == 0).all()
    for force in ("finger_force", "table_force", "hard_contact"):
        assert (after[force][chosen] == 0).all(), force
    # Nor does the rest of their episodes know of it.
    assert_same(run(pick_env, sequence[4:]), run(twin, sequence[4:]), others)


def test_graph_equals_eager_and_seeds_matter(make_pick_env):
    # Half a second per episode: all worlds are reset several times.
    cfg = PickConfig(episode_s=0.5, noise=NOISE, curriculum=CurriculumConfig(start=0.5))
    sequence = actions(12, 4)
    captured = make_pick_env(cfg, 4, seed=5)
    first = run(captured, sequence)
    assert sum(step["done"].sum() for step in first) >= 2 * 4
    assert_same(first, run(make_pick_env(cfg, 4, seed=5, capture=False), sequence))
    # The same environment again, as if it were new.
    captured.reseed(5)
    captured.reset()
    assert_same(first, run(captured, sequence))
    captured.reseed(6)
    captured.reset()
    other = run(captured, sequence)
    assert all((first[i]["qpos"] != other[i]["qpos"]).any(axis=1).all() for i in (0, 6, 11))


def test_a_frozen_camera_stays(make_pick_env):
    env = make_pick_env(PickConfig(camera_pose=(-1.2, -0.7), episode_s=1.0), 4)
    columns = [robot.DOF_NAMES.index(joint) for joint in ("head_pan", "head_tilt")]
    for step in run(env, actions(12, 4)):
        np.testing.assert_allclose(step["qpos"][:, columns], [[-1.2, -0.7]] * 4, atol=1e-3)
    assert env.episode_stats()["episodes"] >= 4


def test_the_start_is_held_and_nothing_moves(pick_env):
    start = pick_env.sim.views.qpos.clone()
    held = pick_env.sim.views.action.clone()
    for _ in range(5):
        _, _, done, _ = pick_env.step(held)
        assert not done.any()
    moved = (pick_env.sim.views.qpos - start).abs()
    assert moved[:, :16].max() < 5e-3  # [m, rad]: robot and object's position


def test_levels_and_near_starts(make_pick_env):
    cfg = PickConfig(curriculum=CurriculumConfig(start=0.2, up=0.3, down=0.15), near_share=(0.9, 0.1))
    env = make_pick_env(cfg, 512)
    views = env.sim.object.views
    assert 0.84 < views.near.float().mean() < 0.96
    env.level.fill_(0.6)
    env.reset()
    assert 0.42 < views.near.float().mean() < 0.58
    env.level.fill_(1.0)
    env.reset()
    assert 0.05 < views.near.float().mean() < 0.16


def test_success_raises_and_failure_lowers_the_level(pick_env):
    pick_env.level.fill_(0.5)
    wp.to_torch(pick_env._progress.succeeded)[2] = True
    pick_env.sim.object.views.pos[[2, 3], 2] = 0.1  # on the floor
    pick_env.step(pick_env.sim.views.action.clone())
    assert pick_env.outcome.tolist()[2:4] == [episode.SUCCESS, len(episode.OUTCOMES)]
    wanted = [0.5, 0.5, 0.6, 0.35, 0.5, 0.5, 0.5, 0.5]
    assert pick_env.level.tolist() == pytest.approx(wanted)
    stats = pick_env.episode_stats()
    assert stats["success_rate"] == stats["dropped_rate"] == 0.5 and stats["object_lost_rate"] == 1.0


def test_statistics_are_of_the_object_that_was(pick_env):
    kinds = [OBJECTS[i % 2] for i in range(8)]
    pick_env.set_objects(kinds)
    pick_env.reset()
    pick_env.set_objects(["can"] * 8)
    wp.to_torch(pick_env._progress.succeeded)[[0, 2, 3]] = True
    pick_env.sim.object.views.pos[:, 2] = 0.1
    pick_env.step(pick_env.sim.views.action.clone())
    assert (pick_env.sim.object.views.kind == OBJECTS.index("can")).all()
    stats = pick_env.episode_stats()
    assert stats[f"object/{OBJECTS[0]}"] == 0.5 and stats[f"object/{OBJECTS[1]}"] == 0.25
    assert np.isnan(stats["object/can"]) and stats["episodes"] == 8


def test_a_world_that_is_not_finite_starts_anew(pick_env):
    pick_env.sim.object.views.velocity[5, 0] = torch.nan
    obs, reward, done, _ = pick_env.step(pick_env.sim.views.action.clone())
    assert pick_env.outcome.tolist() == [0] * 5 + [episode.NON_FINITE, 0, 0] and done[5] == 1
    assert torch.isfinite(reward).all() and all(torch.isfinite(group).all() for group in obs.values())


def test_saved_state_continues_with_the_same_episodes(make_pick_env):
    cfg = PickConfig(episode_s=0.3, noise=NOISE, curriculum=CurriculumConfig(start=0.4, down=0.1))
    env = make_pick_env(cfg, 4, seed=9)
    run(env, actions(4, 4))
    buffer = io.BytesIO()
    torch.save(env.state_dict(), buffer)
    buffer.seek(0)
    resumed = make_pick_env(cfg, 4, seed=9)
    resumed.load_state_dict(torch.load(buffer, weights_only=True))
    env.reset()
    assert_same(run(resumed, actions(5, 4, seed=1)), run(env, actions(5, 4, seed=1)))
