"""Navigation among obstacles that move: resets, collisions and what the camera sees."""

import numpy as np
import torch
from nav_worlds import actions, assert_same, run, snapshot

from spin_rl.scenes.corridors.params import GeneratorParams
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.tasks.common import episode
from spin_rl.tasks.nav.config import NavConfig

BOX = PoolSpec().first_box
MOVING = GeneratorParams(emerging_share=0.5, patrolling_share=0.5, wall_height=(2.0, 2.0))


def crossing() -> Scene:
    """A box that reaches the standing robot from the left after 0.6 s."""
    scene = Scene.empty(PoolSpec())
    scene.goal[:] = (5.0, 0.0)
    scene.active[BOX] = True
    scene.half_size[BOX] = 0.1
    scene.pos[BOX], scene.home[BOX] = (-0.1, 0.9, 0.1), (-0.1, 0.0, 0.1)
    scene.retreat[BOX] = (0.0, 0.9)
    scene.motion_speed[BOX] = 1.0
    return scene


def test_a_thing_that_runs_into_the_robot_ends_the_episode_and_starts_anew(make_nav_env):
    env = make_nav_env(num_envs=2, scene=crossing())
    still = torch.zeros(2, 10)
    lengths, length = [], 0
    while len(lengths) < 3:
        _, _, done, _ = env.step(still.to(env.device))
        length += 1
        assert length < 20
        if done.any():
            assert done.tolist() == [1, 1] and env.outcome.tolist() == [episode.COLLISION] * 2
            np.testing.assert_allclose(env.sim.layout.pos.numpy()[:, BOX], [(-0.1, 0.9, 0.1)] * 2, atol=1e-6)
            lengths.append(length)
            length = 0
    # 0.62 m to go at 1 m/s; the contact is flagged in the next substep at the latest.
    assert lengths == [7, 7, 7]


def test_a_reset_leaves_the_motion_of_other_worlds_alone(make_nav_env):
    env = make_nav_env(NavConfig(scene=MOVING, stop_on_collision=False, difficulty=2), num_envs=4, seed=1)
    run(env, actions(5, 4))
    before, moved = snapshot(env), env.sim.layout.moved.numpy().copy()
    assert (moved > 0.0).any(axis=1).all()
    env.episode_length_buf[1] = env.max_episode_length
    _, _, done, _ = env.step(torch.zeros(4, 10).to(env.device))
    assert done.tolist() == [0, 1, 0, 0]
    after, still_moved = snapshot(env), env.sim.layout.moved.numpy()
    others = [0, 2, 3]
    assert not still_moved[1].any()
    assert (still_moved[others] >= moved[others]).all() and (still_moved[others] > moved[others]).any()
    for name in ("home", "retreat", "motion_speed", "motion_trigger", "motion_phase", "half_size", "active"):
        assert np.array_equal(before[f"layout_{name}"][others], after[f"layout_{name}"][others]), name
    geoms = [env.sim.mj_model.geom(name).id for name in PoolSpec().geom_names()]
    active = after["layout_active"]
    assert np.array_equal(after["geom_xpos"][:, geoms][active], after["layout_pos"][active])


def test_a_graph_gives_the_same_bits_as_eager_launches(make_nav_env):
    sequence = actions(40, 8, seed=2, forward=1.0)
    records = [
        run(make_nav_env(NavConfig(scene=MOVING, difficulty=2), seed=4, capture=capture), sequence)
        for capture in (True, False)
    ]
    assert_same(*records)
    assert any(step["done"].any() for step in records[0])


def test_what_waits_in_a_wall_is_not_seen_and_what_came_out_is(make_nav_env):
    cfg = NavConfig(scene=MOVING, camera_pose=(0.0, -0.6), scenario=1, difficulty=2, stop_on_collision=False)
    env = make_nav_env(cfg, num_envs=64, seed=6)
    layout = env.sim.layout
    coming = layout.motion_trigger.numpy() > 0.0
    forward = torch.zeros(64, 10)
    forward[:, 0] = 0.7
    was_seen = np.zeros_like(coming)
    near = 0
    for _ in range(30):
        waiting = coming & (layout.moved.numpy() == 0.0)
        seen = env.scandots.visible.numpy()[..., 24:].any(axis=-1)
        near += (env.scandots.all.numpy()[..., 24:].any(axis=-1) & waiting).sum()
        assert not (seen & waiting).any()
        was_seen |= seen
        env.step(forward.to(env.device))
    assert near > 100 and (was_seen & coming).sum() > 5
