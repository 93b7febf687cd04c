"""A fetch behind the loop: who acts in which stage, what ends it, and robots that cannot run it."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from conftest import ScriptedNetwork, without_images
from fake_robot import CAMERA, DATA, STATE, FakeRobot

from spin_rl.config import ConfigError
from spin_rl.deploy.agent import Agent, Inputs
from spin_rl.deploy.fetch import numbers as n
from spin_rl.deploy.fetch.agent import BUNDLE, FetchAgent, files_of, open_agent
from spin_rl.deploy.fetch.known import Grip, Known, Slots, tell
from spin_rl.deploy.fetch.stages import DROPPED, HIT, PLACED, Rules
from spin_rl.deploy.interface import Connection
from spin_rl.deploy.loop import ControlLoop
from spin_rl.deploy.observations import in_base, out_of_base

SETTINGS = {
    "limits": dict(zip(n.STAGES, (60.0, 30.0, 12.0, 20.0, 60.0, 25.0), strict=True)),
    "retries": 1, "goal_tolerance_m": 0.15, "home_tolerance_m": 0.35, "place_m": 0.5, "lift_m": 0.1,
    "hold_s": 0.2, "grasp_force_n": 10.0, "finger_force_n": 1.0, "hard_force_n": 30.0, "fall_m": 0.05,
    "carry_moves": ["lift"], "carry_lift_m": 0.5, "pick_range_m": None,
}  # fmt: skip
RULES = Rules(**{key: value for key, value in SETTINGS.items() if key != "pick_range_m"})
TABLE = Slots(np.array([[2.7, 0.0, 0.3]]), np.zeros(1), np.array([[0.3, 0.6, 0.3]]), np.array([False]))
ON_TABLE = np.array([2.5, 0.0, 0.65])
GOAL = np.array([1.8, 0.0])
IMAGE = np.full((87, 58), 2.0, dtype=np.float32)
NOTHING = Grip((0.0, 0.0), 0.0, 0.0, True)
HELD = Grip((8.0, 8.0), 0.0, 0.0, False)


def told(grip=NOTHING, at=ON_TABLE, seen=False):
    return tell(Known(grip, np.array(at), 0.0, seen, 0.07, TABLE, TABLE))


def at(x, y=0.0, yaw=0.0):
    return replace(STATE, base=np.array([x, y, yaw]))


@pytest.fixture
def fetch(nav_network, pick_network):
    """A fetch whose policies drive ahead, and turn; and their networks."""
    nav = ScriptedNetwork(nav_network.contract, [(1.0, *[0.0] * 9)])
    pick = ScriptedNetwork(pick_network.contract, [(0.0, 1.0, *[0.0] * 8)])
    return FetchAgent(Agent(nav), Agent(pick), RULES), nav, pick


def step(agent, state, groups):
    inputs = Inputs(state, IMAGE, groups)
    why = agent.progress(inputs)
    return why, None if why else agent.act(inputs)[1]


def begin(agent, object_b=None):
    agent.reset(at(0.0), GOAL, object_b)
    assert step(agent, at(0.0), told())[0] is None


def test_each_stage_has_its_policy_and_a_policy_begins_without_memory(fetch):
    agent, nav, pick = fetch
    begin(agent)
    assert len(nav.seen) == 1 and agent.memory.stage == n.REACH
    assert step(agent, at(1.7), told(seen=True))[1].forward == 0.0
    assert agent.memory.stage == n.ALIGN and nav.seen == []
    np.testing.assert_allclose(agent.memory.found, ON_TABLE, atol=1e-6)
    agent.memory.ready, agent.memory.phase = True, 7
    _, command = step(agent, at(1.7, yaw=1.5), told(seen=True))
    assert agent.memory.stage == n.PICK and len(pick.seen) == 1 and command.turn > 0.0
    told_start = pick.seen[0]["object_start"][0]
    np.testing.assert_allclose(told_start, in_base(ON_TABLE, np.array([1.7, 0.0, 1.5])), atol=1e-5)
    for _ in range(2):
        step(agent, at(1.7), told(HELD, ON_TABLE + [0.0, 0.0, 0.15]))
    assert agent.memory.stage == n.RETRACT and pick.seen != []
    agent.memory.ready = True
    step(agent, at(1.7), told(HELD))
    assert agent.memory.stage == n.CARRY and len(nav.seen) == 1
    np.testing.assert_allclose(nav.seen[0]["goal"][0], np.array([-1.7, 0.0, 1.7]) / 2.5, atol=1e-5)
    step(agent, at(0.2), told(HELD))
    assert agent.memory.stage == n.PLACE
    agent.memory.ready, agent.memory.phase = True, 5
    assert step(agent, at(0.2), told(at=(0.3, 0.0, 0.05)))[0] == PLACED


def test_one_of_the_policies_may_see_images(nav_network, pick_network):
    nav = ScriptedNetwork(without_images(nav_network.contract))
    agent = FetchAgent(Agent(nav), Agent(ScriptedNetwork(pick_network.contract)), RULES)
    assert agent.reads_images and agent.contract.name == nav.contract.name
    assert agent.contract.camera == pick_network.contract.camera
    other = FetchAgent(Agent(ScriptedNetwork(nav_network.contract)), Agent(nav), RULES)
    assert other.reads_images and other.contract == nav_network.contract


def test_targets_go_on_where_the_other_policy_left_them(fetch):
    agent, *_ = fetch
    begin(agent)
    target = step(agent, at(1.7), told(seen=True))[1].joints
    agent.memory.ready, agent.memory.phase = True, 7
    step(agent, at(1.7), told(seen=True))
    moved = np.abs(agent._active.target - target)
    assert moved.max() < 0.5  # a policy that starts anew would begin at the joints


@pytest.mark.parametrize(
    ("groups", "why"),
    [
        (told(Grip((0.0, 0.0), 0.0, 31.0, True)), HIT),
        (told(at=(2.5, 0.0, 0.4)), DROPPED),
    ],
)
def test_what_ends_a_fetch(fetch, groups, why):
    agent, *_ = fetch
    begin(agent)
    step(agent, at(1.7), told())
    assert agent.memory.stage == n.ALIGN and step(agent, at(1.7), groups)[0] == why


def test_the_object_can_be_told_by_the_caller(fetch):
    agent, *_ = fetch
    start = at(0.5, 1.0, np.pi / 2)
    agent.reset(start, GOAL, np.array([2.0, 0.5, 0.7]))
    np.testing.assert_allclose(agent.memory.found, [0.0, 3.0, 0.7], atol=1e-9)
    assert agent.memory.is_found
    np.testing.assert_allclose(in_base(out_of_base(ON_TABLE, start.base), start.base), ON_TABLE, atol=1e-12)


def test_robots_that_do_not_know_what_a_fetch_must_are_refused(fetch):
    agent, *_ = fetch
    real = FakeRobot(connection=Connection(is_real=True, camera=CAMERA))
    with pytest.raises(ConfigError, match="a fetch must know 'grip', which this back end cannot tell"):
        ControlLoop(real, real.connect(), agent)
    knowing = FakeRobot(told_groups=told())
    loop = ControlLoop(knowing, knowing.connect(), agent)
    with pytest.raises(ConfigError, match="goal: tiny_nav needs one"):
        loop.run(1.0)
    outcome = loop.run(0.35, GOAL)
    assert outcome.steps == 4 and outcome.distance_m < 1.8 and knowing.calls[-1] == "stop"


def test_bundles_are_read_and_checked(tmp_path):
    for name in ("tiny_nav.onnx", "tiny_pick.onnx"):
        shutil.copy(DATA / name, tmp_path)
    values = {"policies": {"nav": "tiny_nav.onnx", "pick": "tiny_pick.onnx"}, "settings": SETTINGS}
    (tmp_path / BUNDLE).write_text(json.dumps(values))
    assert isinstance(open_agent(tmp_path), FetchAgent) and isinstance(
        open_agent(tmp_path / BUNDLE), FetchAgent
    )
    assert [file.name for file in files_of(tmp_path)] == [BUNDLE, "tiny_nav.onnx", "tiny_pick.onnx"]
    limits = {name: value for name, value in SETTINGS["limits"].items() if name != "reach"}
    swapped = {"nav": "tiny_pick.onnx", "pick": "tiny_nav.onnx"}
    for changes, message in [
        ({"settings": SETTINGS | {"retries": "many"}}, r"fetch\.json: retries: expected a whole number"),
        ({"settings": SETTINGS | {"limits": limits}}, r"fetch\.json: limits: needs reach, "),
        ({"policies": swapped}, r"fetch\.json: nav is a policy of task=pick"),
    ]:
        (tmp_path / BUNDLE).write_text(json.dumps(values | changes))
        with pytest.raises(ConfigError, match=message):
            open_agent(tmp_path)
    (tmp_path / BUNDLE).write_text(json.dumps({"policies": {}}))
    with pytest.raises(ConfigError, match=r"fetch\.json is no fetch of spin-export"):
        open_agent(tmp_path)
