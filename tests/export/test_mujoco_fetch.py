"""An object in C MuJoCo behind the runtime: what it tells of it, and whole fetches and picks."""

import json

import numpy as np
import pytest
import torch

from spin_rl import robot
from spin_rl.config import ConfigError
from spin_rl.deploy.agent import Agent
from spin_rl.deploy.backends import open_backend
from spin_rl.deploy.fetch.agent import open_agent
from spin_rl.deploy.fetch.known import TOLD, read
from spin_rl.deploy.fetch.stages import PLACED
from spin_rl.deploy.interface import Command, Connection
from spin_rl.deploy.log import RunLog, read_log
from spin_rl.deploy.loop import ControlLoop
from spin_rl.deploy.network import Network
from spin_rl.deploy.observations import seen_object
from spin_rl.deploy.replay import replay
from spin_rl.export.write import export_fetch, export_policy
from spin_rl.runners.policy_file import read_policy
from spin_rl.tasks.common import formulas

SCENE = """
start: {position: [0, 0]}
goal: [4, 0]
joints: {gripper_finger: 0.05}
walls:
  - {position: [2.7, 0.55], size: [7.4, 0.1, 1.5]}
  - {position: [2.7, -0.55], size: [7.4, 0.1, 1.5]}
boxes:
  - {position: [5.1, 0, 0.3], size: [0.7, 0.98, 0.6]}
  - {position: [2.0, 0.3, 1.3], size: [0.3, 0.3, 0.2]}
"""
FAST = np.array(robot.SPEED_PROFILES["paper"].joint_velocity_max)


@pytest.fixture(scope="module")
def settings(tmp_path_factory):
    path = tmp_path_factory.mktemp("scenes") / "table.yaml"
    path.write_text(SCENE)
    return {"scene": str(path), "object": "mug", "object_at": [5.0, 0.05]}


@pytest.fixture(scope="module")
def contract():
    from test_mujoco_robot import DATA

    return Network(DATA / "tiny_pick.onnx").contract


def hold(one, forward=0.0, **targets):
    joints = dict(zip(robot.JOINTS, one.state().joints, strict=True)) | targets
    return Command(forward, 0.0, np.array([joints[name] for name in robot.JOINTS]), FAST)


def test_the_object_stands_on_the_table_and_is_told(contract, settings):
    one = open_backend("mujoco", settings, contract)
    connection = one.connect()
    assert connection.object_b == pytest.approx((5.0, 0.05, 0.6405), abs=1e-3)
    told = one.told()
    assert set(told) == {*TOLD, "object"}
    one.sleep_until(0.5)
    known = read(one.told())
    np.testing.assert_allclose(known.object_at, [5.0, 0.05, 0.6405], atol=2e-3)
    assert known.grip.is_supported and not known.grip.holds and known.object_speed < 0.01
    assert known.table.pos[0].tolist() == pytest.approx([5.1, 0.0, 0.3]) and len(known.near.yaw) == 4
    assert not known.is_seen and not one.told()["object"].any()  # 5 m away, beyond the detector's range


def test_the_object_is_seen_in_the_camera_and_not_behind_things(contract, settings):
    one = open_backend("mujoco", settings, contract)
    one.data.qpos[0] = 4.0
    one.data.qpos[robot.DOF_NAMES.index("head_tilt")] = -0.6
    assert read(one.told()).is_seen
    group = one.told()["object"][0]
    assert group[:4] == pytest.approx([1.0, 1.0, 0.05, 0.6405], abs=1e-3) and np.abs(group[4:]).max() == 1.0
    one.data.qpos[robot.DOF_NAMES.index("head_pan")] = -2.0
    assert not read(one.told()).is_seen
    one.data.qpos[robot.DOF_NAMES.index("head_pan")] = 0.0
    one.data.qpos[len(robot.DOF_NAMES) + 2] = 0.3  # inside of the table
    assert not read(one.told()).is_seen


def test_what_is_pushed_is_felt(contract, settings):
    one = open_backend("mujoco", settings, contract)
    one.data.qpos[0] = 4.66
    one.command(hold(one, forward=0.4))
    one.sleep_until(0.6)
    assert read(one.told()).grip.hard_n > 30.0


def test_the_group_of_a_seen_object_is_that_of_training():
    rng = np.random.default_rng(0)
    for _ in range(20):
        at, hand, base = rng.normal(size=3), rng.normal(size=3), rng.normal(size=3)
        gripper = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        hand = at + 0.2 * hand
        told = [torch.tensor(values)[None] for values in (at, base, hand, gripper)]
        np.testing.assert_allclose(
            seen_object(at, base, hand, gripper), formulas.seen_object(*told)[0].numpy(), atol=1e-12
        )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"object_at": [9.0, 0.0]}, r"robot\.object_at: there is no box at \[9\.0, 0\.0\]"),
        ({"object": "spoon"}, r"robot\.object: unknown 'spoon'"),
        ({"object": None}, "one needs the other"),
    ],
)
def test_objects_that_cannot_stand_are_refused(contract, settings, changes, message):
    with pytest.raises(ConfigError, match=message):
        open_backend("mujoco", settings | changes, contract)


def test_policies_that_need_a_detector_are_refused_without_one(settings, tmp_path):
    path = export_policy(read_policy("pick-teacher"), tmp_path / "pick-teacher.onnx").path
    agent = Agent(Network(path))
    message = "pick-teacher reads 'object', which this back end cannot tell"
    with pytest.raises(ConfigError, match=message):
        agent.check(Connection(is_real=True), set())
    blind = open_backend("mujoco", {"scene": settings["scene"]}, agent.contract)
    with pytest.raises(ConfigError, match=message):
        ControlLoop(blind, blind.connect(), agent)
    seeing = open_backend("mujoco", settings, agent.contract)
    ControlLoop(seeing, seeing.connect(), agent)


@pytest.mark.slow
def test_a_whole_fetch_places_the_object_and_replays(settings, tmp_path):
    bundle = tmp_path / "fetch"
    export_fetch("nav-cvo", None, bundle)
    agent = open_agent(bundle)
    one = open_backend("mujoco", settings, agent.contract)
    connection = one.connect()
    log = RunLog(tmp_path / "fetch.jsonl", json.loads("{}"))
    goal, thing = np.array(connection.goal), np.array(connection.object_b)
    outcome = ControlLoop(one, connection, agent, log).run(200.0, goal, thing)
    log.close()
    assert outcome.reason == PLACED and not outcome.stopped
    at = one.data.body("object").xpos
    assert np.hypot(*at[:2]) < 0.5 and at[2] < 0.1
    assert replay(read_log(tmp_path / "fetch.jsonl"), open_agent(bundle)).agrees
