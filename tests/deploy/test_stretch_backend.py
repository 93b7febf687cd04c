"""The back end for stretch_body and a RealSense, on a fake of both."""

import math
import re
import signal
import sys
import time

import fake_stretch_body
import numpy as np
import pytest

from spin_rl import robot
from spin_rl.config import ConfigError
from spin_rl.deploy.backends import open_backend
from spin_rl.deploy.interface import Command, DeviceLost
from spin_rl.deploy.loop import TIME_OVER, ControlLoop

FAR = np.array([50.0, 0.0])
TARGET = np.array([0.7, 0.2, 0.5, -0.3, 0.1, 0.2, -0.4, -0.2])
SPEED = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8])


@pytest.fixture
def fakes(monkeypatch):
    """The class of robots, and the camera."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield fake_stretch_body.install(monkeypatch)
    signal.signal(signal.SIGINT, before)


def connect(contract, **settings):
    opened = open_backend("stretch", settings, contract)
    return opened, opened.connect(), fake_stretch_body.LAST[-1]


def test_a_command_moves_every_joint_at_its_speed_and_is_sent_once(fakes, nav_network):
    opened, _, body = connect(nav_network.contract)
    opened.command(Command(0.2, -0.5, TARGET, SPEED))
    pct = 0.2 / fake_stretch_body.FINGER_RAD_PER_PCT
    servo = 0.6 / fake_stretch_body.FINGER_RAD_PER_PCT / fake_stretch_body.PCT_PER_SERVO_RAD
    assert body.calls == [
        ("base", 0.2, -0.5), ("lift", 0.7, 0.1), ("arm", 0.2, 0.2), ("wrist_yaw", 0.5, 0.3),
        ("wrist_pitch", -0.3, 0.4), ("wrist_roll", 0.1, 0.5), ("head_pan", -0.4, 0.7),
        ("head_tilt", -0.2, 0.8), ("stretch_gripper", pytest.approx(pct), pytest.approx(servo)), ("push",),
    ]  # fmt: skip
    state = opened.state()
    np.testing.assert_allclose(state.joints, TARGET)
    np.testing.assert_allclose(state.base_velocity, [0.2, -0.5])
    assert state.homed and not state.runstop and opened.clock.now() - state.stamp_s < 0.2


def test_stopping_stands_first_and_keeps_the_grip(fakes, nav_network):
    opened, _, body = connect(nav_network.contract)
    body.is_slow = True
    opened.command(Command(0.2, 0.0, TARGET, SPEED))
    body.calls.clear()
    opened.stop()
    opened.stop()
    assert body.calls[:2] == [("base", 0.0, 0.0), ("push",)]
    assert {call[0] for call in body.calls if call[1:] == ("by", 0.0)} == {"lift", "arm"}
    held = {call[0]: call[1] for call in body.calls if call[1:2] != ("by",) and len(call) == 3}
    held.pop("base")
    assert held == {name: 0.1 for name in (*fake_stretch_body.WRIST, "head_pan", "head_tilt")}
    assert opened.state().base_velocity.tolist() == [0.0, 0.0]
    opened.close()
    assert body.calls[-1] == ("shutdown",) and fakes[1].stopped


def test_the_fingers_speed_is_in_radians(fakes, nav_network):
    opened, _, body = connect(nav_network.contract)
    gripper = body.end_of_arm.motors["stretch_gripper"]
    gripper.status["vel"] = -2.0
    at, then = (fake_stretch_body.FINGER_RAD_PER_PCT * gripper.world_rad_to_pct(rad) for rad in (1.0, 3.0))
    velocity = opened.state().joint_velocity[robot.JOINTS.index("gripper_finger")]
    assert velocity == pytest.approx(at - then) and velocity < 0.0


@pytest.mark.parametrize("device", ["left_wheel", "right_wheel", "lift", "arm", "pimu", "head", "end_of_arm"])
def test_a_device_that_does_not_answer_makes_the_state_old(fakes, nav_network, device):
    opened, _, body = connect(nav_network.contract)
    now = [10.0]
    opened.clock.now = lambda: now[0]
    assert opened.state().stamp_s == 10.0
    body.silent.add(device)
    now[0] = 10.4
    assert opened.state().stamp_s == 10.0
    body.silent.clear()
    now[0] = 10.5
    assert opened.state().stamp_s == 10.5


def test_a_state_before_the_first_answer_is_infinitely_old(fakes, nav_network):
    opened, _, body = connect(nav_network.contract)
    body.is_alive = False
    assert opened.state().stamp_s == -math.inf


def test_the_computers_clock_may_be_set(fakes, nav_network, monkeypatch):
    opened, _, _ = connect(nav_network.contract)
    fakes[1].age_s = -3600.0  # an hour ago by a clock that was set back since
    frame = opened.depth()
    assert frame.stamp_s <= opened.clock.now() < frame.stamp_s + 0.2
    later = time.time() + 3600.0
    monkeypatch.setattr(time, "time", lambda: later)
    assert opened.clock.now() - opened.state().stamp_s < 0.2


def test_what_was_never_connected_stops_and_closes(fakes, nav_network):
    opened = open_backend("stretch", {}, nav_network.contract)
    opened.stop()
    opened.close()
    assert fake_stretch_body.LAST == []


def test_images_are_metres_and_as_old_as_they_are(fakes, nav_network):
    opened, connection, _ = connect(nav_network.contract)
    camera = connection.camera
    assert (camera.mount, camera.width, camera.height, camera.fov_deg) == ("portrait", 848, 480, (87.0, 58.0))
    frame = opened.depth()
    assert frame.image.shape == (480, 848) and np.allclose(frame.image, 2.0)
    assert 0.03 <= opened.clock.now() - frame.stamp_s < 0.2
    fakes[1].frames = 0
    assert opened.depth() is frame
    fakes[1].is_lost = True
    with pytest.raises(DeviceLost, match="camera: Device disconnected"):
        opened.depth()


def test_the_camera_is_the_heads(fakes, nav_network):
    connect(nav_network.contract)
    assert fakes[1].used == "435I"


def test_without_the_heads_camera_there_is_none(monkeypatch, fakes, nav_network):
    fakes[1].names.pop()
    monkeypatch.setitem(sys.modules, "pyrealsense2", fakes[1].module())
    with pytest.raises(ConfigError, match="no D435i, only Intel RealSense D405"):
        connect(nav_network.contract)


def test_the_loop_drives_it_and_leaves_it_standing(fakes, scripted):
    agent = scripted((1.0, *[0.0] * 9))
    opened, connection, body = connect(agent.contract)
    for name, value in robot.STOWED.items():
        (body.head if "head" in name else body.end_of_arm).motors.get(name, body.lift).status["pos"] = value
    body.lift.status["pos"], body.arm.status["pos"] = robot.STOWED["lift"], 0.0
    outcome = ControlLoop(opened, connection, agent).run(0.25, FAR)
    assert outcome.reason == TIME_OVER and 0 < outcome.steps <= 3
    speeds = [call[1] for call in body.calls if call[0] == "base"]
    driven = [0.2, 0.4, 0.6][: outcome.steps]
    assert speeds == pytest.approx([*driven, *[0.0] * (len(speeds) - len(driven))]) and speeds[-1] == 0.0
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize(("fault", "reason"), [("runstop", "runstop"), ("silence", r"state is 0\.[5-9]")])
def test_a_runstop_and_dead_threads_end_the_run(fakes, scripted, fault, reason):
    agent = scripted((1.0, *[0.0] * 9))
    opened, connection, body = connect(agent.contract)
    command = opened.command

    def breaking(told):
        command(told)
        if fault == "runstop":
            body.pimu["runstop_event"] = True
        body.is_alive = False

    opened.command = breaking
    outcome = ControlLoop(opened, connection, agent).run(3.0, FAR)
    assert (
        re.search(reason, outcome.reason) and outcome.stopped
    )  # noticed at the first tick that finds it old
    assert [call[1] for call in body.calls if call[0] == "base"][-1] == 0.0


def test_nothing_moves_in_a_dry_run(fakes, scripted, capsys):
    agent = scripted((1.0, *[0.0] * 9))
    opened, connection, body = connect(agent.contract, dry_run=True)
    ControlLoop(opened, connection, agent).run(0.15, FAR)
    opened.close()
    assert body.calls == [("shutdown",)] and connection.is_real
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("dry run: +0.200 m/s, +0.000 rad/s, lift ") and lines[-1] == "dry run: stop"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda body, camera: setattr(body, "starts", False), "does not start"),
        (lambda body, camera: setattr(body, "tool", ("wrist_yaw", "stretch_gripper")), "no 'wrist_pitch'"),
    ],
)
def test_robots_that_cannot_be_used_are_refused(fakes, nav_network, change, message):
    change(*fakes)
    opened = open_backend("stretch", {}, nav_network.contract)
    with pytest.raises(ConfigError, match=message):
        opened.connect()


def test_a_camera_that_cannot_be_stopped_does_not_keep_the_robot(fakes, nav_network, monkeypatch):
    opened, _, body = connect(nav_network.contract)

    def fail():
        raise RuntimeError("no device")

    monkeypatch.setattr(fakes[1], "stop", fail)
    with pytest.raises(RuntimeError):
        opened.close()
    assert body.calls[-1] == ("shutdown",)


def test_outside_of_a_robot_one_line_says_what_is_missing(monkeypatch, nav_network):
    def fail(module, *_):
        raise KeyError("HELLO_FLEET_PATH")

    monkeypatch.setattr("spin_rl.deploy.backends.stretch.require", fail)
    with pytest.raises(ConfigError, match="'HELLO_FLEET_PATH' in the environment"):
        open_backend("stretch", {}, nav_network.contract)


def test_a_robot_that_is_not_homed_does_not_start(fakes, scripted):
    opened, connection, body = connect(scripted().contract)
    body.homed = False
    with pytest.raises(ConfigError, match="not homed"):
        ControlLoop(opened, connection, scripted()).run(1.0, FAR)
    assert not any(call[0] == "base" and call[1] for call in body.calls)


def test_cameras_without_the_size_or_a_common_clock_are_refused(fakes, nav_network):
    with pytest.raises(ConfigError, match="no depth images of 4000 x 3000"):
        connect(nav_network.contract, width=4000, height=3000)
    opened, _, _ = connect(nav_network.contract)
    fakes[1].domain = "hardware"
    with pytest.raises(ConfigError, match="its own clock"):
        opened.depth()


def test_without_the_library_one_line_says_what_to_install(monkeypatch, nav_network):
    monkeypatch.setitem(sys.modules, "stretch_body", None)
    with pytest.raises(ConfigError, match=r"hello-robot-stretch-body.*spin-rl\[stretch\]"):
        open_backend("stretch", {}, nav_network.contract)
    with pytest.raises(ConfigError, match=r"ros2 needs a package that is not installed"):
        open_backend("ros2", {}, nav_network.contract)
