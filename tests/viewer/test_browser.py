import socket
from dataclasses import replace

import numpy as np
import pytest
from viewer_worlds import POOL, SCENE, fetch_snapshot, pick_snapshot, snapshot

from spin_rl.benchmark.untrained import ZeroPolicy
from spin_rl.config import ConfigError
from spin_rl.tasks.fetch.config import FetchConfig
from spin_rl.tasks.fetch.env import FetchEnv
from spin_rl.viewer import style
from spin_rl.viewer.browser.scene import WorldView
from spin_rl.viewer.overlay import FRUSTUM_LENGTH_M
from spin_rl.viewer.rollout import Player
from spin_rl.viewer.stage import Stage

viser = pytest.importorskip("viser")


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def server():
    server = viser.ViserServer(host="127.0.0.1", port=free_port(), verbose=False)
    yield server
    server.stop()


@pytest.fixture
def browser():
    from spin_rl.viewer.browser.view import Browser

    with Browser("127.0.0.1", free_port()) as browser:
        yield browser


def test_world_view_places_bodies_slots_and_overlays(server):
    stage = Stage(POOL, "portrait")
    view = WorldView(server, stage, "/world_0")
    state = snapshot(base=(0.4, 0.1, 0.5), head_pan=0.3)
    view.update(state, np.array([-0.4, 6.0]))
    np.testing.assert_allclose(view._root.position, (-0.4, 6.0, 0.0))
    assert len(view._bodies) == len({int(b) for b in stage.model.geom_bodyid}) - 1  # all but the world
    for body, handle in view._bodies.items():
        np.testing.assert_allclose(handle.position, stage.data.xpos[body])
        np.testing.assert_allclose(handle.wxyz, stage.data.xquat[body])
    assert view._goal.name == "/world_0/goal" and len(view._slots) == SCENE.active.sum()
    walls = [handle for handle in view._slots.values() if "/wall_" in handle.name]
    assert all(wall.opacity < 0.5 for wall in walls) and len(walls) == 2
    seen, unseen = view._dots[True], view._dots[False]
    np.testing.assert_allclose(seen.points, state.scandots.points[:1])
    np.testing.assert_allclose(unseen.points, state.scandots.points[1:])
    assert tuple(seen.colors[0]) == style.SEEN and tuple(unseen.colors[0]) == style.UNSEEN
    camera = stage.depth_camera()
    np.testing.assert_allclose(view._frustum.position, camera.pos)
    turned = viser.transforms.SO3(view._frustum.wxyz).as_matrix()
    edges = view._frustum.position + view._frustum.points.reshape(-1, 3) @ turned.T
    corners = camera.frustum(FRUSTUM_LENGTH_M)
    np.testing.assert_allclose(edges.reshape(8, 2, 3)[:4, 1], corners[1:], atol=1e-5)


def test_a_new_scene_replaces_the_old_one(server):
    view = WorldView(server, Stage(POOL, "portrait"), "/world_0")
    view.update(snapshot(), np.zeros(2))
    before = dict(view._slots)
    view.update(snapshot(time=0.1), np.zeros(2))
    assert view._slots == before  # the same scene: sent once
    view._scene = None
    view.update(snapshot(), np.zeros(2))
    assert view._slots.keys() == before.keys()
    assert not set(map(id, view._slots.values())) & set(map(id, before.values()))


def test_what_moves_is_moved_and_not_sent_again(server):
    view = WorldView(server, Stage(POOL, "portrait"), "/world_0")
    view.update(snapshot(), np.zeros(2))
    before = dict(view._slots)
    pos = SCENE.pos + (0.0, 0.1, 0.0)
    view.update(replace(snapshot(time=0.1), scene=replace(SCENE, pos=pos)), np.zeros(2))
    assert view._slots == before
    for slot, handle in view._slots.items():
        np.testing.assert_allclose(handle.position, pos[slot])


def test_panel_runs_resets_and_changes_cells(browser, make_nav_env):
    env = make_nav_env(num_envs=2)
    opened = []

    def open_player(name):
        if name == "broken":
            raise ConfigError("policy: it is damaged")
        opened.append(name)
        player = Player(env, ZeroPolicy())
        player.start(1, 0, seed=0)
        return player

    browser.run(open_player, ["zero", "broken"], 1, 0, max_seconds=0.5)
    assert opened == ["zero"] and len(browser._views) == 2
    assert "running" in browser._status.content
    # The first robot is followed: it is at the origin, and the other world beside its own.
    player = open_player("zero")
    browser.show(player.snapshots, player)
    place = player.snapshots[0].qpos[:2]
    np.testing.assert_allclose(browser._views[0]._root.position[:2], -place)
    np.testing.assert_allclose(browser._views[1]._root.position[:2], -place + (0.0, -6.5))
    browser._follow.value = False
    browser.show(player.step(), player)
    np.testing.assert_allclose(browser._views[0]._root.position[:2], -place)
    before = browser._choice()
    browser._scenario.value, browser._difficulty.value = "2", "hard"
    player = browser._change(player, open_player, before)
    assert all(s.scene.scenario == 2 and s.scene.difficulty == 2 for s in player.snapshots)
    before = browser._choice()
    browser._policy.value = "broken"
    assert browser._change(player, open_player, before) is player
    assert browser._policy.value == "zero"


def test_statistics_count_outcomes():
    from spin_rl.viewer.browser.view import statistics_text

    assert "No episode" in statistics_text([])
    ended = [snapshot(time=8.0, outcome="success"), snapshot(time=2.0, outcome="collision")] * 2
    text = statistics_text(ended)
    assert "| success | 2 | 50% |" in text and "successes: 8.0 s" in text and "Last: collision" in text


def test_a_taken_port_is_an_error_that_names_it():
    from spin_rl.viewer.browser.view import Browser

    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(ConfigError, match=f"port: cannot listen on 127.0.0.1:{port}"):
            Browser("127.0.0.1", port)


def test_the_object_moves_and_a_new_one_replaces_it(server):
    stage = Stage(POOL, "portrait", with_object=True)
    view = WorldView(server, stage, "/world_0")
    first = pick_snapshot("banana", seen=True)
    view.update(first, np.zeros(2))
    root = view._object_root
    assert view._goal is None
    np.testing.assert_allclose(view._dots[True].points, first.target.pose[None, :3], atol=1e-6)
    moved = replace(first, target=replace(first.target, pose=np.array((1.0, 0.9, 1.1, 1.0, 0.0, 0.0, 0.0))))
    view.update(moved, np.zeros(2))
    assert view._object_root is root
    np.testing.assert_allclose(root.position, (1.0, 0.9, 1.1))
    view.update(pick_snapshot("mug"), np.zeros(2))
    assert view._object_root is not root


def test_the_goal_of_a_fetch_moves_to_the_start(server):
    view = WorldView(server, Stage(POOL, "portrait", with_object=True), "/world_0")
    reach = fetch_snapshot("reach")
    view.update(reach, np.zeros(2))
    goal, slots = view._goal, dict(view._slots)
    np.testing.assert_allclose(goal.position[:2], SCENE.goal)
    carry = replace(reach, stage="carry", scene=replace(SCENE, goal=np.array([0.1, 0.2])))
    view.update(carry, np.zeros(2))
    assert view._goal is goal and view._slots == slots
    np.testing.assert_allclose(goal.position[:2], (0.1, 0.2))


def test_a_fetch_plays_and_the_status_tells_its_stage(browser, device):
    env = FetchEnv(FetchConfig(), 1, device)

    def open_player(name):
        player = Player(env, ZeroPolicy())
        player.start(2, 0, seed=3)
        return player

    browser.run(open_player, ["zero"], 2, 0, max_seconds=0.5)
    assert "reach, running" in browser._status.content and "goal in" in browser._status.content
    assert browser._scenario.visible and browser._views[0]._object_root is not None
    player = open_player("zero")
    env.sim.views.qpos[0, :2] = env.goal[0]
    browser.show(player.step(), player)
    assert "align, running" in browser._status.content
    browser._scenario.value = "1"
    browser._change(player, open_player, ("zero", "2", "easy"))
    assert player.snapshots[0].scene.scenario == 1 and "reach" in browser._status.content
