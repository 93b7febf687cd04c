"""The back end for the ROS 2 driver, on a fake of both."""

import time

import fake_ros
import numpy as np
import pytest
from conftest import ScriptedNetwork, without_images

from spin_rl import robot
from spin_rl.config import ConfigError
from spin_rl.deploy.agent import Agent
from spin_rl.deploy.backends import open_backend, ros2
from spin_rl.deploy.interface import Command, DeviceLost
from spin_rl.deploy.loop import TIME_OVER, ControlLoop

FAR = np.array([50.0, 0.0])
SPEED = np.full(8, 1000.0)


@pytest.fixture
def driver(monkeypatch):
    made = fake_ros.install(monkeypatch)
    monkeypatch.setattr(ros2, "_ANSWER_S", 0.3)
    yield made
    made.is_up = False


def connect(contract, **settings):
    opened = open_backend("ros2", settings, contract)
    return opened, opened.connect()


@pytest.fixture
def driving(nav_network):
    """A contract that reads no images."""
    return without_images(nav_network.contract)


def test_it_switches_the_driver_and_reads_what_it_measures(driver, driving):
    opened, connection = connect(driving)
    assert connection.is_real and connection.camera is None
    assert driver.calls == ["/switch_to_navigation_mode", "/activate_streaming_position"]
    assert driver.signals == "no handlers"
    state = opened.state()
    assert dict(zip(robot.JOINTS, state.joints, strict=True)) == {
        "lift": 0.6, "arm_extension": 0.1, "wrist_yaw": 3.0, "wrist_pitch": -0.6, "wrist_roll": 0.0,
        "gripper_finger": 0.1, "head_pan": 0.0, "head_tilt": -0.6,
    }  # fmt: skip
    np.testing.assert_allclose(state.base, [1.0, 2.0, 0.5])
    assert state.homed and not state.runstop and -0.01 < opened.clock.now() - state.stamp_s < 0.2
    driver.age_s = 0.7
    time.sleep(0.1)
    assert 0.7 < opened.clock.now() - opened.state().stamp_s < 0.9
    opened.close()
    assert not driver.is_up


def test_messages_grow_old_whatever_the_computers_clock_says(driver, driving, monkeypatch):
    opened, _ = connect(driving)
    driver.age_s = -3600.0  # stamped before the clock was set back
    time.sleep(0.1)
    driver.is_up = False  # nothing comes any more
    time.sleep(0.1)
    first = opened.state().stamp_s
    assert first <= opened.clock.now()
    monkeypatch.setattr(time, "time", lambda: 0.0)
    assert opened.state().stamp_s == first


def test_the_fingers_speed_is_that_of_their_positions(driver, driving, monkeypatch):
    opened, _ = connect(driving)
    driver.is_up = False
    time.sleep(0.1)  # its own thread is done
    start = time.time() + 1.0
    for i in range(3):
        monkeypatch.setattr(time, "time", lambda i=i: start + 0.03 * i)
        driver.pose[fake_ros.FINGER] = 0.1 - 0.015 * i
        driver.publish_all()
    velocity = opened.state().joint_velocity
    assert velocity[robot.JOINTS.index("gripper_finger")] == pytest.approx(-0.5, abs=1e-3)
    assert np.count_nonzero(velocity) == 1
    driver.publish_all()  # the same message once more
    np.testing.assert_array_equal(opened.state().joint_velocity, velocity)


def test_commands_are_in_the_drivers_order(driver, driving):
    opened, _ = connect(driving)
    values = dict(zip(robot.JOINTS, np.arange(8) / 10, strict=True))
    opened.command(Command(0.3, -0.2, np.array(list(values.values())), SPEED))
    assert driver.calls[-2] == (0.3, -0.2)
    order = ("arm_extension", "lift", "wrist_yaw", "wrist_pitch", "wrist_roll", "head_pan", "head_tilt")
    assert driver.calls[-1] == pytest.approx([*map(values.get, order), values["gripper_finger"], 0.0, 0.0])
    np.testing.assert_allclose(opened.state().joints, list(values.values()))
    np.testing.assert_allclose(opened.state().base_velocity, [0.3, -0.2])


def test_targets_move_at_the_joints_speeds(driver, driving):
    opened, _ = connect(driving)
    now = [0.0]
    opened.clock.now = lambda: now[0]
    lift = []
    for now[0] in (100.0, 100.1, 100.2):
        opened.command(Command(0.0, 0.0, np.full(8, 0.9), np.full(8, 0.5)))
        lift.append(driver.calls[-1][fake_ros.LIFT])
    assert lift == pytest.approx([0.7, 0.75, 0.8])  # from 0.6; of the time before the first, 0.2 s count


def test_stopping_stands_and_keeps_the_grip(driver, driving):
    opened, _ = connect(driving)
    opened.stop()
    assert driver.calls[-1] == (0.0, 0.0)  # joints were told nothing yet, and hold by themselves
    opened.command(Command(0.3, 0.0, np.full(8, -0.05), SPEED))
    driver.pose[fake_ros.FINGER] = 0.2  # an object keeps them open
    time.sleep(0.1)
    opened.stop()
    assert driver.calls[-2] == (0.0, 0.0)
    held = driver.calls[-1]
    assert (held[fake_ros.FINGER], held[fake_ros.LIFT]) == pytest.approx((-0.05, -0.05))


@pytest.mark.parametrize("encoding", ["16UC1", "32FC1", "rgb8"])
def test_images_are_metres(driver, nav_network, encoding):
    driver.encoding = encoding
    opened, connection = connect(nav_network.contract)
    camera = connection.camera
    assert (camera.width, camera.height) == (87, 58)
    assert camera.fov_deg == pytest.approx((87.0, 58.0), abs=0.1)
    if encoding == "rgb8":
        with pytest.raises(ConfigError, match=r"robot\.depth: images are 'rgb8'"):
            opened.depth()
    else:
        frame = opened.depth()
        assert frame.image.shape == (4, 6) and np.allclose(frame.image, 1.5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"silent": {"/odom"}}, r"robot\.odom: nothing comes from /odom"),
        ({"names": fake_ros.NAMES[:3] * 2}, r"joint_states: no 'joint_gripper_finger_left'"),
        ({"absent": {"/activate_streaming_position"}}, "no service /activate_streaming_position"),
        ({"refuses": {"/switch_to_navigation_mode"}}, "refuses /switch_to_navigation_mode"),
    ],
)
def test_drivers_that_cannot_be_used_are_refused(driver, driving, change, message):
    vars(driver).update(change)
    with pytest.raises(ConfigError, match=message):
        connect(driving)


def test_the_loop_drives_it_and_leaves_it_standing(driver, driving):
    agent = Agent(ScriptedNetwork(driving, ((1.0, *[0.0] * 9),)))
    opened, connection = connect(agent.contract)
    outcome = ControlLoop(opened, connection, agent).run(0.25, FAR)
    assert outcome.reason == TIME_OVER and 0 < outcome.steps <= 3
    speeds = [call[0] for call in driver.calls if isinstance(call, tuple)]
    driven = [0.2, 0.4, 0.6][: outcome.steps]
    assert speeds[: len(driven)] == pytest.approx(driven) and set(speeds[len(driven) :]) == {0.0}


@pytest.mark.parametrize(
    ("change", "reason"),
    [({"runstopped": True}, "runstop"), ({"mode": "position"}, "mode 'position'"), ({"age_s": 0.8}, "0.8")],
)
def test_what_goes_wrong_ends_the_run(driver, driving, change, reason):
    agent = Agent(ScriptedNetwork(driving, ((1.0, *[0.0] * 9),)))
    opened, connection = connect(agent.contract)
    command = opened.command

    def breaking(told):
        command(told)
        vars(driver).update(change)

    opened.command = breaking
    outcome = ControlLoop(opened, connection, agent).run(2.0, FAR)
    assert reason in outcome.reason and outcome.stopped and driver.speed == (0.0, 0.0)


def test_nothing_moves_in_a_dry_run(driver, driving, capsys):
    opened, _ = connect(driving, dry_run=True)
    opened.command(Command(0.3, 0.0, np.zeros(8), SPEED))
    opened.stop()
    assert all(isinstance(call, str) for call in driver.calls)
    assert capsys.readouterr().out.count("dry run: ") == 2


def test_a_driver_that_leaves_the_mode_is_lost(driver, driving):
    opened, _ = connect(driving)
    driver.mode = "trajectory"
    time.sleep(0.1)
    with pytest.raises(DeviceLost, match="'trajectory'"):
        opened.state()
