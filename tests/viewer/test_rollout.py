from dataclasses import replace

import numpy as np
import pytest
import torch
import warp as wp
from viewer_worlds import SCENE, fetch_snapshot, snapshot

from spin_rl import robot
from spin_rl.benchmark.untrained import RandomPolicy, ZeroPolicy
from spin_rl.scenes.corridors.params import GeneratorParams
from spin_rl.sensors.depth.filter_config import DepthFilterConfig
from spin_rl.sensors.depth.pipeline import DepthConfig
from spin_rl.tasks.fetch.config import STAGES, FetchConfig
from spin_rl.tasks.fetch.env import FetchEnv
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.pick.config import PickConfig
from spin_rl.tasks.pick.env import PickEnv
from spin_rl.viewer.plots import GROUPS, nearest, plot_episode, trace_of, write_plots
from spin_rl.viewer.reader import scandots_of
from spin_rl.viewer.rollout import Player
from spin_rl.viewer.video import play


def test_scandots_are_world_points_seen_or_not():
    known, visible = np.zeros((2, 32)), np.zeros((2, 32))
    known[:, 24:26] = 1.0
    known[:, :3], known[:, 3:6] = (1.0, 0.0, 0.5), (0.0, 1.0, 0.2)
    visible[:, 24] = 1.0
    visible[:, :3] = (1.0, 0.0, 0.5)
    dots = scandots_of(known, visible, np.array([True, False]), np.array([2.0, 3.0, np.pi / 2]))
    # The wall's (first) corners are all listed beside the seen one; the box's seen corner is listed once.
    unseen = [(2.0, 4.0, 0.5), (1.0, 3.0, 0.2), (1.0, 3.0, 0.2)]
    np.testing.assert_allclose(dots.points, [*unseen, *[(2.0, 4.0, 0.5)] * 2], atol=1e-12)
    assert dots.seen.tolist() == [False, False, False, True, True]


def test_player_shows_the_state_that_ended_an_episode(make_nav_env):
    # Two steps of 0.1 s, then a timeout.
    env = make_nav_env(NavConfig(episode_s=0.2), num_envs=2, seed=5)
    player = Player(env, ZeroPolicy())
    first = player.start(1, 2, seed=5)
    assert [(s.scene.scenario, s.scene.difficulty) for s in first] == [(1, 2)] * 2
    np.testing.assert_allclose(first[0].qpos[:3], first[0].scene.start, atol=1e-6)
    assert first[0].depth is None  # no depth camera in this task
    second, third = player.step(), player.step()
    assert [s.outcome for s in second] == ["running"] * 2
    for world, last in enumerate(third):
        assert last.outcome == "timeout" and last.ended
        assert last.time == pytest.approx(0.2) and last.episode == 0
        assert last.scene is first[world].scene
        # Not the next episode's start; the base stands still.
        np.testing.assert_allclose(last.qpos[:3], second[world].qpos[:3], atol=0.01)
        new = player.snapshots[world]
        assert new.episode == 1 and new.time == 0.0 and new.scene is not last.scene
        np.testing.assert_allclose(new.qpos[:3], new.scene.start, atol=1e-6)
    assert len(player.ended) == 2


def test_snapshots_hold_the_image_that_the_policy_gets(make_nav_env):
    # From 1 to 2 m, so that a mistake in the scale shows.
    depth = DepthConfig(filter=DepthFilterConfig(near_m=1.0, far_m=2.0))
    env = make_nav_env(NavConfig(depth=depth), num_envs=2, seed=5)
    player = Player(env, ZeroPolicy())
    player.start(1, 2, seed=5)
    player.step()
    measured = env.depth.camera.depth.numpy()
    measured[measured == 0.0] = 10.0  # nothing hit
    assert measured.min() < 1.0 < 2.0 < measured.max()
    for world, state in enumerate(player.snapshots):
        np.testing.assert_allclose(state.depth, measured[world].clip(1.0, 2.0), atol=1e-5)


def test_scenes_of_snapshots_follow_what_moves(make_nav_env):
    params = GeneratorParams(patrolling_share=1.0)
    env = make_nav_env(NavConfig(scene=params), num_envs=2, seed=5)
    player = Player(env, ZeroPolicy())
    first, second = player.start(1, 2, seed=5), player.step()
    for world, (a, b) in enumerate(zip(first, second, strict=True)):
        moving = a.scene.motion_speed > 0.0
        travelled = np.linalg.norm(b.scene.pos - a.scene.pos, axis=1)
        assert moving.any() and (travelled[moving] > 0.0).all() and not travelled[~moving].any()
        assert (travelled <= 0.1 * a.scene.motion_speed + 1e-5).all()
        np.testing.assert_allclose(b.scene.pos, env.sim.layout.scene(world).pos)
        assert b.scene.half_size is a.scene.half_size  # one episode


def test_distances_of_a_trace_are_to_where_things_are(make_nav_env):
    near, far = snapshot(), snapshot(time=0.1)
    pos = SCENE.pos.copy()
    pos[SCENE.pool.first_box, 0] += 1.0
    trace = trace_of([near, replace(far, scene=replace(SCENE, pos=pos))])
    low = next(name for name, levels in GROUPS.items() if "low" in levels)
    assert trace.distance[low][1] - trace.distance[low][0] > 0.5


def test_a_seed_gives_the_same_episodes_again(make_nav_env):
    env = make_nav_env(NavConfig(episode_s=0.5), num_envs=1, seed=0)
    records = []
    for _ in range(2):
        player = Player(env, RandomPolicy("cpu" if env.device == "cpu" else env.device))
        player.start(2, 1, seed=4)
        records.append([[s.qpos for s in episode] for episode in play(player, 2)])
    assert len(records[0]) == 2
    for a, b in zip(*records, strict=True):
        np.testing.assert_array_equal(np.array(a), np.array(b))


def test_scandots_of_a_snapshot_are_corners_of_its_scene(nav_env):
    player = Player(nav_env, ZeroPolicy())
    for state in player.start(1, 2, seed=3):
        scene, points = state.scene, state.scandots.points
        assert len(points) == len(state.scandots.seen) > 0
        top = scene.pos[:, 2] + scene.half_size[:, 2]
        bottom = scene.pos[:, 2] - scene.half_size[:, 2]
        heights = np.concatenate((bottom, top))[np.tile(scene.active, 2)]
        # What is seen of a wall may start and end anywhere; everything else is at a bottom or a top.
        unseen = points[~state.scandots.seen, 2]
        assert (np.abs(unseen[:, None] - heights).min(1) < 1e-5).all()


def test_distance_to_obstacles_of_a_level():
    points = np.array([[1.0, 0.3], [1.0, -1.0], [3.0, 0.0], [2.0, -0.05]])
    low, head = nearest(SCENE, points, ("low",)), nearest(SCENE, points, ("head",))
    assert low[0] == 0.0 and head[3] == pytest.approx(0.05)
    assert nearest(SCENE, points, ("tall",))[2] == pytest.approx(0.2, abs=1e-3)
    assert np.isinf(nearest(SCENE, points, ("arm",))).all()
    assert low[1] > 1.0  # walls do not count


def test_plots_of_an_episode(tmp_path):
    pytest.importorskip("matplotlib")
    path = [(0.0, -0.3, 0.6), (0.5, -0.9, 0.8), (1.5, -0.2, 0.3)]
    episode = [
        snapshot(time=0.1 * i, base=(x, 0.0, 0.0), head_tilt=tilt, lift=lift, arm_outer=0.1, arm_inner=0.1)
        for i, (x, tilt, lift) in enumerate(path)
    ]
    trace = trace_of(episode)
    np.testing.assert_allclose(trace.tilt, [-0.3, -0.9, -0.2])
    np.testing.assert_allclose(trace.extension, 0.2)
    figure = plot_episode(trace, "title")
    tilt = figure.axes[2].lines[0]
    np.testing.assert_allclose(tilt.get_ydata(), np.degrees(trace.tilt))
    files = write_plots(tmp_path / "new", [episode, episode], "zero")
    assert [file.name for file in files] == ["episode_001.png", "episode_002.png"]
    assert all(file.stat().st_size > 10_000 for file in files)


def test_player_shows_the_object_of_every_episode(device):
    # Two steps of 0.1 s, then a timeout.
    env = PickEnv(PickConfig(episode_s=0.2, near_share=(0.0, 0.0)), 2, device)
    env.set_objects(["mug", "banana"])
    player = Player(env, ZeroPolicy())
    first = player.start(1, 2, seed=5)
    for state in first:
        assert state.scandots is None and state.qpos.shape == (len(robot.DOF_NAMES),)
        what = state.target.what
        np.testing.assert_allclose(state.target.pose[:3], what.start_pose[:3], atol=1e-5)
        assert state.target.height == pytest.approx(0.0, abs=1e-5) and state.target.force == 0.0
        np.testing.assert_array_equal(state.marks.points, state.target.pose[None, :3])
        assert state.marks.seen.tolist() == [state.target.seen]
    assert [state.target.what.kind for state in first] == ["mug", "banana"]
    seen = [state.target.seen for state in player.step()]
    np.testing.assert_array_equal(seen, env.sight.seen.numpy())
    for world, last in enumerate(player.step()):
        assert last.outcome == "timeout" and last.target.what is first[world].target.what
        np.testing.assert_array_equal(last.target.pose, env.final_qpos[world, -7:].cpu().numpy())
        new = player.snapshots[world].target
        assert new.what is not last.target.what and new.what.kind == last.target.what.kind
        np.testing.assert_allclose(new.pose[:3], new.what.start_pose[:3], atol=1e-5)


def test_player_shows_stage_object_and_present_goal_of_fetches(device):
    env = FetchEnv(FetchConfig(), 2, device)
    env.set_objects(["mug", "banana"])
    player = Player(env, ZeroPolicy())
    first = player.start(2, 0, seed=5)
    for state in first:
        assert state.stage == "reach" and state.scene.scenario == 2 and state.scene.difficulty == 0
        assert len(state.scandots.points) > 0
        assert state.target.height == pytest.approx(0.0, abs=1e-4)
        offset = state.target.pose[:2] - state.scene.start[:2]
        assert state.put_distance == pytest.approx(float(np.linalg.norm(offset))) and state.put_distance > 1.0
        np.testing.assert_array_equal(state.marks.points[-1], state.target.pose[:3])
    table = first[0].scene.goal

    # The first robot has come to the table, folded what it holds, and is about to carry it back.
    env.sim.views.qpos[0, :2] = env.goal[0]
    assert [state.stage for state in player.step()] == ["align", "reach"]
    for name, value in (("stage", STAGES.index("retract")), ("phase", 4), ("phase_time", 10)):
        wp.to_torch(getattr(env._state, name))[0] = value
    env.sim.views.target[0] = torch.tensor([robot.STOWED[name] for name in robot.JOINTS])
    carry, other = player.step()
    assert (carry.stage, other.stage) == ("carry", "reach")
    np.testing.assert_allclose(carry.scene.goal, carry.scene.start[:2])
    assert carry.scene.half_size is first[0].scene.half_size and first[0].scene.goal is table
    assert other.scene is first[1].scene

    # Its hand is empty, which ends the fetch; the next one has a goal at its own table.
    while not carry.ended:
        carry = player.step()[0]
    assert carry.cause == "carry dropped" and carry.scene.goal is not table
    new = player.snapshots[0]
    assert new.stage == "reach" and new.goal_distance > 2.0


def test_plots_name_the_stages_where_they_begin():
    pytest.importorskip("matplotlib")
    stages = ["reach", "reach", "align", "pick", "align"]
    trace = trace_of([fetch_snapshot(stage, time=0.1 * i) for i, stage in enumerate(stages)])
    names = [(pytest.approx(0.1 * i), stages[i]) for i in (0, 2, 3, 4)]
    assert trace.stages == names
    assert [text.get_text() for text in plot_episode(trace, "a fetch").axes[0].texts] == [
        "reach", "align", "pick", "align"
    ]  # fmt: skip
    assert trace_of([snapshot()]).stages == []


def test_a_task_without_corners_and_objects_has_no_marks():
    marks = replace(snapshot(), scandots=None).marks
    assert marks.points.shape == (0, 3) and marks.seen.shape == (0,)
