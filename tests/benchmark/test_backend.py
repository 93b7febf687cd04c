"""Benchmarks again in C MuJoCo: the same starts, the same rules, and outcomes in pairs."""

import pickle
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from spin_rl import robot
from spin_rl.benchmark import policies, reach
from spin_rl.benchmark.backend import again as backend
from spin_rl.benchmark.backend.recorder import Recorder
from spin_rl.benchmark.backend.umpires import DriveUmpire, PickUmpire
from spin_rl.benchmark.tables import backend as tables
from spin_rl.config import ConfigError
from spin_rl.deploy.fetch.known import Grip
from spin_rl.scenes.builder import native_model
from spin_rl.scenes.scene_file import parse_scene
from spin_rl.sensors.depth.filter_config import DepthFilterConfig
from spin_rl.sensors.depth.noise import DepthNoiseConfig
from spin_rl.sensors.depth.pipeline import DepthConfig
from spin_rl.tasks.common import episode
from spin_rl.tasks.common.config import DynamicsConfig
from spin_rl.tasks.common.objects.config import SightConfig
from spin_rl.tasks.nav.config import GuardConfig, NavConfig, NavNoise
from spin_rl.tasks.pick import episode as pick_episode
from spin_rl.tasks.pick.config import PickConfig

NOMINAL = DynamicsConfig((0.15, 0.15), (0.1, 0.1), (1.0, 1.0))
TINY = Path(__file__).parents[1] / "data" / "tiny_nav.onnx"


def batched(cfg, device, episodes=1, seeds=(0,)):
    """The reach benchmark of a policy that stands still, as `evaluate_again` takes it."""
    make = policies.open_policy("zero").make
    return lambda watch: reach.evaluate_reach(
        make, cfg, episodes, seeds, device, report=lambda line: None, watch=watch
    )


def test_every_episode_is_run_again_from_its_start_and_paired_by_condition(monkeypatch, device):
    cfg, seen = NavConfig(episode_s=0.2, dynamics=NOMINAL), []

    def pretend(start, **settings):
        """Succeed in hard corridors."""
        pickle.dumps((start, settings))  # as other processes get them
        seen.append(start)
        hard = start.scene.difficulty == 2
        return {"outcome": episode.SUCCESS if hard else episode.COLLISION, "steps": 1, "distance": 0.0,
                "parts": np.ones(6, dtype=bool), "way": start.way, "driven": start.way}  # fmt: skip

    monkeypatch.setattr(backend, "run_episode", pretend)
    lines = []
    result = backend.evaluate_again(batched(cfg, device, 2, (3, 4)), cfg, TINY, report=lines.append)
    assert len(seen) == 24 and {start.most_steps for start in seen} == {2}
    assert len({tuple(start.scene.start) for start in seen}) == 24
    assert "24 of 24" in lines[-1]
    for row in result["rows"]:
        hard = row["difficulty"] == "hard"
        assert row["episodes"] == row["batched"]["episodes"] == 4
        assert row["success_rate"] == row["difference"]["mean"] == float(hard)
        assert row["batched"]["success_rate"] == 0.0 and row["batched"]["timeout_rate"] == 1.0
        assert (row["difference"]["won"], row["difference"]["lost"]) == (4 * hard, 0)
    assert result["overall"]["success_rate"] == pytest.approx(1 / 3)
    assert result["overall"]["batched"] == {"success_rate": 0.0}
    text = tables.table(result).splitlines()
    assert text[4].split()[:6] == ["1", "hard", "1.00", "0.51-1.00", "0.1", "s"] and "+1.000" in text[4]
    assert tables.headline(result).startswith("success 0.333, batched 0.000, difference +")


def test_a_recorded_episode_starts_there_and_lasts_as_long(device):
    cfg = NavConfig(episode_s=1.0, dynamics=NOMINAL)
    recorder = Recorder()
    result = batched(cfg, device)(recorder)
    assert [len(group.outcome) for group in recorder.ends] == [6]
    assert (recorder.ends[0].outcome == episode.TIMEOUT).all() and (recorder.ends[0].steps == 10).all()
    start = recorder.starts[2]
    row = backend.run_episode(start, path=TINY, cfg=cfg)
    assert row["outcome"] in (episode.TIMEOUT, episode.COLLISION) and 0 < row["steps"] <= 10
    assert row["way"] == start.way > 3.0
    standing = result["rows"][2]["final_distance_m"]
    assert row["distance"] == pytest.approx(standing, abs=0.8)  # no farther than it can have driven
    assert row["driven"] <= 0.8


def test_what_cannot_be_paired_is_one_line(device):
    noisy = DepthConfig(noise=replace(DepthNoiseConfig(), dropout=0.1))
    cases = [
        (NavConfig(goal_tolerance_m=0.3), r"task\.goal_tolerance_m: is 0\.3, and 0\.15 in the exported"),
        (NavConfig(camera_pose=(0.0, -0.2)), r"task\.camera_pose: is \(0\.0, -0\.2\), and None in"),
        (NavConfig(robot_profile="re1"), r"robot\.profile: is re1, and paper in"),
        (NavConfig(depth=noisy), "depth: images of the other simulator are exact"),
        (PickConfig(detector="segmentation"), r"task\.detector: "),
        (
            NavConfig(guard=GuardConfig(enabled=True)),
            r"task\.guard: is \{.*'margin_m': 0\.03.*\}, and None in the exported",
        ),
        (NavConfig(noise=NavNoise(goal_m=0.1)), r"task\.noise\.goal_m: the other simulator measures exactly"),
        (NavConfig(), r"task\.dynamics\.base_lag_s: is \(0\.1, 0\.2\), and \(0\.15, 0\.15\) in the other"),
        (NavConfig(goal_range_m=3.0), r"task\.goal_range_m: is 3\.0, and None in the exported"),
        (NavConfig(depth=DepthConfig(filter=DepthFilterConfig(hold_steps=9))), r"depth\.filter: is "),
        (PickConfig(sight=SightConfig(far_m=2.0)), r"task\.sight: is "),
    ]
    for config, message in cases:
        with pytest.raises(ConfigError, match=message):
            backend.evaluate_again(lambda watch: {}, config, TINY)


@pytest.fixture
def at_a_wall():
    """The robot 0.2 m before a wall."""
    wall = {"position": [0.309, 0.0], "size": [0.1, 2.0, 0.15]}
    scene = parse_scene({"start": {"position": [0, 0]}, "goal": [0.3, 0.4], "walls": [wall]})
    model = native_model(scene)
    data = mujoco.MjData(model)
    data.qpos[:] = robot.qpos_from_joints(model, robot.STOWED)
    return model, data


def test_a_touch_ends_a_drive(at_a_wall):
    model, data = at_a_wall
    umpire = DriveUmpire(model, data, np.array([0.3, 0.4]), 0.5)
    for x in (0.0, 0.1, 0.25):
        assert not umpire.is_over
        data.qpos[0] = x
        mujoco.mj_forward(model, data)
        umpire.add_substep(data)
        umpire.judge(data)
    assert umpire.is_over and umpire.outcome == episode.COLLISION
    figures = umpire.figures(data)
    assert figures["parts"].tolist() == [part == "base" for part in robot.PARTS]
    assert figures["driven"] == pytest.approx(0.25) and figures["way"] == 0.5
    assert figures["distance"] == pytest.approx(np.hypot(0.05, 0.4))


HELD = Grip((6.0, 5.0), 0.0, 0.0, False)
PICKS = {
    "held long enough": ([(HELD, 0.11)] * 10, episode.SUCCESS),
    "not yet": ([(HELD, 0.11)] * 9, episode.RUNNING),
    "let go in between": ([(HELD, 0.11)] * 9 + [(HELD, 0.09)] + [(HELD, 0.11)] * 9, episode.RUNNING),
    "by one finger": ([(replace(HELD, fingers_n=(20.0, 0.5)), 0.11)] * 12, episode.RUNNING),
    "too loose": ([(replace(HELD, fingers_n=(5.0, 4.9)), 0.11)] * 12, episode.RUNNING),
    "on something": ([(replace(HELD, is_supported=True), 0.11)] * 12, episode.RUNNING),
    "hit with the success": (
        [(HELD, 0.11)] * 9 + [(replace(HELD, hard_n=31.0), 0.11)], episode.COLLISION
    ),
    "brushed": ([(replace(HELD, hard_n=29.0), 0.0)], episode.RUNNING),
    "fallen": ([(HELD, -0.111)], int(pick_episode.DROPPED)),
    "on the edge": ([(HELD, -0.109)], episode.RUNNING),
}  # fmt: skip


@pytest.mark.parametrize("case", PICKS)
def test_how_picks_end(case):
    steps, outcome = PICKS[case]
    model: Any = None
    handled: Any = SimpleNamespace(grip=HELD, start=np.array([0.0, -0.7, 0.8]))
    umpire = PickUmpire(model, handled, 0.06, PickConfig())
    data: Any = SimpleNamespace(qpos=np.zeros(20))
    for grip, height in steps:
        assert not umpire.is_over
        handled.grip, data.qpos[15] = grip, 0.8 + height
        umpire.judge(data)
    assert umpire.outcome == outcome


@pytest.mark.slow
def test_a_pick_in_c_mujoco_begins_as_in_the_batched_simulation(device):
    from spin_rl.deploy.backends.mujoco import MujocoRobot
    from spin_rl.deploy.network import Network
    from spin_rl.tasks.pick.env import PickEnv

    cfg = PickConfig(end_on_success=True)
    env = PickEnv(cfg, 3, device, 5)
    recorder = Recorder()
    recorder(env, policies.open_policy("zero").make(env.reset(), device), 0).reset()
    for world, start in enumerate(recorder.starts):
        assert start.thing is not None
        one = MujocoRobot(
            start.scene,
            Network(TINY.with_name("tiny_pick.onnx")).contract,
            thing=(start.thing, start.scene.pool.first_box),
        )
        np.testing.assert_allclose(one.data.qpos, env.sim.views.qpos[world].cpu(), atol=1e-5)
        row = backend.run_episode(start, path=TINY.with_name("tiny_pick.onnx"), cfg=cfg)
        assert 0 < row["steps"] <= 70 and row["distance"] > 0.0
