"""A camera held at one pose for a whole fetch: neither policies nor scripts move it."""

import pytest
import torch
import warp as wp
from fetch_worlds import ALIGN, CARRY, PICK, PLACE, REACH, RETRACT, enter, state

from spin_rl.config import ConfigError
from spin_rl.export import write
from spin_rl.tasks.fetch.config import FetchConfig

POSE = (-0.8, -0.5)


def test_the_head_stays_in_every_stage(make_fetch_env):
    env = make_fetch_env(FetchConfig(camera_pose=POSE), num_envs=6, seed=3)
    target = wp.to_torch(env.sim.target)
    held = torch.tensor(POSE, device=env.device).expand(6, 2)
    torch.testing.assert_close(env.sim.views.qpos[:, 11:13], held)  # it starts there
    for world, stage in enumerate((REACH, ALIGN, PICK, RETRACT, CARRY, PLACE)):
        enter(env, stage, world)
    actions = torch.full((6, 10), 0.0, device=env.device)
    actions[:, -2:] = 0.9
    for _ in range(5):
        env.step(actions)
        torch.testing.assert_close(target[:, -2:], held, atol=1e-5, rtol=0)
    assert (env.sim.views.qpos[:, 11:13] - held).abs().max() < 0.02


def test_without_a_pose_scripts_look_around(make_fetch_env):
    env = make_fetch_env(num_envs=2, seed=3)
    state(env, "is_found").fill_(False)
    for world in range(2):
        enter(env, ALIGN, world)
    before = wp.to_torch(env.sim.target)[:, -2].clone()
    env.step(torch.zeros(2, 10, device=env.device))
    assert (wp.to_torch(env.sim.target)[:, -2] - before).abs().min() > 0.01


@pytest.mark.parametrize("cfg", [FetchConfig(camera_pose=POSE), FetchConfig(head_sweeps=False)])
def test_the_base_looks_around_in_the_place_of_the_head(make_fetch_env, cfg):
    env = make_fetch_env(cfg, num_envs=2, seed=3)
    state(env, "is_found").fill_(False)
    for world in range(2):
        enter(env, ALIGN, world)
    before, head = env.sim.views.qpos[:, :3].clone(), wp.to_torch(env.sim.target)[:, -2:].clone()
    for _ in range(10):
        env.step(torch.zeros(2, 10, device=env.device))
        state(env, "is_found").fill_(False)
    moved = env.sim.views.qpos[:, :3] - before
    assert moved[:, :2].norm(dim=1).max() < 0.05 and moved[:, 2].abs().min() > 0.3
    torch.testing.assert_close(wp.to_torch(env.sim.target)[:, -2:], head, atol=1e-5, rtol=0)


@pytest.mark.parametrize(("pose", "stage"), [(POSE, PICK), (None, ALIGN)])
def test_only_a_head_that_can_turn_must_see_the_object_when_the_pick_begins(make_fetch_env, pose, stage):
    env = make_fetch_env(FetchConfig(camera_pose=pose), num_envs=2, seed=3)
    for world in range(2):
        enter(env, ALIGN, world)
    state(env, "ready").fill_(True)
    state(env, "phase").fill_(7)
    state(env, "phase_time").fill_(100)
    env.sight.seen.zero_()
    env.step(torch.zeros(2, 10, device=env.device))
    assert env.stage.tolist() == [stage, stage]


@pytest.mark.parametrize("setting", [{"camera_pose": POSE}, {"head_sweeps": False}])
def test_a_fetch_whose_stages_do_not_turn_the_head_is_not_exported(tmp_path, monkeypatch, setting):
    monkeypatch.setattr(write, "open_for", lambda *_: None)
    said = rf"^task\.{next(iter(setting))}: the stages of an exported fetch"
    with pytest.raises(ConfigError, match=said):
        write.export_fetch("a", "b", tmp_path, FetchConfig(**setting))
