"""The pilot in the control loop: what the policy is told, what is sent, and that a log tells all of it."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from conftest import ScriptedNetwork
from fake_robot import DATA, STATE, FakeRobot
from pilot_worlds import SCANDOTS, camera_at, contract, look, picture, stowed

from spin_rl.cli import deploy as command
from spin_rl.config import ConfigError
from spin_rl.deploy.agent import Agent, Inputs
from spin_rl.deploy.log import RunLog, read_log
from spin_rl.deploy.loop import TIME_OVER, ControlLoop
from spin_rl.deploy.metadata import read_metadata, write_metadata
from spin_rl.deploy.network import Network
from spin_rl.deploy.pilot.pilot import Pilot
from spin_rl.deploy.replay import replay
from spin_rl.deploy.text import summary

GOAL = np.array([3.0, 0.0])
WALL = ((0.55, -1.0, 0.0), (0.65, 2.0, 1.2))
TOLD = {"scandots": np.zeros((1, SCANDOTS), dtype=np.float32)}
AHEAD = (1.0, *[0.0] * 9)


@pytest.fixture
def agent():
    """One that wants ahead for ever."""
    return Agent(ScriptedNetwork(contract(), (AHEAD,)))


class Robot(FakeRobot):
    """Drives ahead in front of a wall and sees it, in the camera's own image."""

    def __init__(self, **settings):
        super().__init__(start=replace(STATE, joints=stowed()), told_groups=TOLD, **settings)

    def state(self):
        return replace(super().state(), base_velocity=self.now_moving.copy())

    def depth(self):
        self.image = np.rot90(picture([WALL], camera_at(self.start.joints, self.pose)), 1)
        return super().depth()


def run(agent, tmp_path, seconds=4.0, goal=GOAL, **settings):
    one = Robot(**settings)
    log = RunLog(tmp_path / "run.jsonl", {})
    outcome = ControlLoop(one, one.connect(), agent, log).run(seconds, goal)
    log.close()
    return one, outcome


def test_it_stops_before_the_wall_and_a_policy_alone_does_not(agent, tmp_path):
    one, outcome = run(agent, tmp_path, 2.0)
    assert outcome.steps == 20 and 0.2 < one.pose[0] < 0.55 - 0.06
    assert agent.pilot is not None and agent.pilot.is_guarded
    alone = Agent(ScriptedNetwork(contract(), (AHEAD,)), pilot=False)
    assert alone.pilot is None and not alone.reads_images
    assert run(alone, tmp_path, 2.0)[0].pose[0] > 1.0


@pytest.mark.parametrize("goal", [(60.0, 0.0), (9.0, -13.0)])
def test_it_stops_before_the_wall_however_far_the_goal_is(agent, tmp_path, goal):
    one, outcome = run(agent, tmp_path, 2.0, np.array(goal))
    assert outcome.steps == 20 and 0.2 < one.pose[0] < 0.55 - 0.06


@pytest.mark.parametrize("goal", [(0.6, 0.5), (0.65, 0.0), (0.1, 20.0)])
def test_a_goal_in_a_wall_or_off_the_map_breaks_nothing(agent, tmp_path, goal):
    one, outcome = run(agent, tmp_path, 8.0, np.array(goal))
    assert outcome.reason == TIME_OVER and one.pose[0] < 0.55 - 0.06


def test_images_of_some_time_ago_are_replayed_too(agent, tmp_path):
    _, outcome = run(agent, tmp_path, 2.0, image_age_s=0.25)
    logged = read_log(tmp_path / "run.jsonl")
    assert outcome.steps == 20 and all(
        step.inputs.taken_s == step.inputs.state.stamp_s - 0.25 for step in logged.steps()
    )
    assert replay(logged, agent).action_error == 0.0


def test_the_policy_is_told_the_way_and_the_command_that_was_sent(agent):
    agent.reset(STATE, GOAL)
    look(agent.pilot, [WALL], STATE.base)
    image = picture([WALL], camera_at(STATE.joints, STATE.base))
    inputs = Inputs(replace(STATE, base_velocity=np.array([0.7, 0.0])), image, TOLD)
    before = [agent.act(inputs)[0] for _ in range(6)][-1]  # until there is a plan
    agent.act(inputs)
    told = agent._network.seen[-1]
    goal = 2.5 * told["goal"][0]
    assert goal[1] < -0.5 and 1.0 < goal[2] < 2.1  # round the wall's near end
    assert np.abs(before[:2] - AHEAD[:2]).max() > 0.2
    np.testing.assert_allclose(told["proprio"][0, -10:], before, atol=1e-6)


def test_a_replay_gives_the_same_actions(agent, tmp_path):
    run(agent, tmp_path, 6.0)
    logged = read_log(tmp_path / "run.jsonl")
    result = replay(logged, agent)
    assert result.steps == 60 and result.agrees and result.action_error == 0.0
    actions = np.array([step.action for step in logged.steps()])
    assert len(np.unique(actions[:, 0])) > 3  # among them those of a way out
    assert not replay(logged, Agent(ScriptedNetwork(contract(), (AHEAD,)), pilot=False)).agrees


def test_without_images_it_does_not_start(agent):
    blind = FakeRobot(connection=replace(FakeRobot().connection, camera=None), told_groups=TOLD)
    with pytest.raises(ConfigError, match="no depth camera"):
        ControlLoop(blind, blind.connect(), agent)


def test_an_image_that_is_too_old_ends_the_run(agent):
    one = FakeRobot(told_groups=TOLD, image_age_s=2.0)
    outcome = ControlLoop(one, one.connect(), agent).run(1.0, GOAL)
    assert outcome.stopped and "image is 2.00 s old" in outcome.reason


def test_the_command_takes_it_along_and_leaves_it_out(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("fake_robot.open_robot", lambda settings, contract: Robot())
    policy, log = DATA / "tiny_room.onnx", tmp_path / "a.jsonl"
    for pilot, has_images in (("true", True), ("false", False)):
        drive = [
            f"policy={policy}",
            "backend=fake_robot",
            "goal=[3,0]",
            "max_s=1",
            f"log={log}",
            f"pilot={pilot}",
        ]
        for arguments in (drive, [f"replay={log}"]):
            monkeypatch.setattr(sys, "argv", ["spin-deploy", *map(str, arguments)])
            with pytest.raises(SystemExit) as ended:
                command.main()
        assert ended.value.code == 0 and "the same" in capsys.readouterr().out
        assert all((step.inputs.depth is not None) == has_images for step in read_log(log).steps())


def test_a_file_says_what_its_pilot_is():
    told = Network(DATA / "tiny_room.onnx").contract
    assert read_metadata(write_metadata(told), "file") == told
    text = summary(told)
    assert "Guard: look_ahead_s 0.5" in text and "Planner: ahead_m 2" in text and "pilot alone" in text


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"shapes": ()}, "need shapes"),
        ({"goal": None}, "need shapes, a goal"),
        ({"guard": None}, "planner: needs the guard"),
        ({"shapes": contract().shapes[:1]}, "one of each hull"),
    ],
)
def test_a_pilot_without_what_it_needs_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(contract(), **changes)


def test_a_pilot_of_another_robot_is_refused():
    first, *others = contract().shapes
    of_another = replace(contract(), shapes=(replace(first, body="left_leg"), *others))
    with pytest.raises(ConfigError, match="has no body 'left_leg'"):
        Pilot(of_another)
