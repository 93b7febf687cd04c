"""The control loop on a robot that breaks: whatever happens, the last thing that it is told is to stand."""

import math
import os
import signal
from dataclasses import replace

import numpy as np
import pytest
from fake_robot import CAMERA, STATE, FakeRobot

from spin_rl import robot
from spin_rl.config import ConfigError
from spin_rl.deploy.clock import MonotonicClock, StopSignals
from spin_rl.deploy.interface import Connection, DeviceLost
from spin_rl.deploy.loop import ARRIVED, TIME_OVER, ControlLoop

FAR = np.array([50.0, 0.0])


def run(agent, fake, max_s=2.0, goal=FAR):
    return ControlLoop(fake, fake.connect(), agent).run(max_s, goal)


def lose(fake, state):
    raise DeviceLost("the base does not answer")


def kill(number):
    return lambda fake, state: os.kill(os.getpid(), number)


def age(seconds):
    return lambda fake, state: replace(state, stamp_s=state.stamp_s - seconds)


def broken(**changes):
    return lambda fake, state: replace(state, **changes)


def set_image(**changes):
    def change(fake, state):
        for key, value in changes.items():
            setattr(fake, key, value)

    return change


# State 0 is that of the start; tick k reads state k + 1.
@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (broken(runstop=True), "runstop"),
        (broken(joints=np.full(8, math.nan)), "not finite"),
        (broken(base=np.array([0.0, math.inf, 0.0])), "not finite"),
        (age(0.51), "state is 0.51 s old"),
        (age(-0.6), "state is -0.60 s old"),
        (age(math.inf), "state is inf s old"),
        (set_image(image_age_s=-1.0), "image is -1.00 s old"),
        (set_image(image_age_s=0.6), "image is 0.60 s old"),
        (set_image(image=None), "no depth image"),
        (set_image(image=np.ones((20, 20))), "at least 87 x 58"),
        (broken(base=np.array([0.0, 1.0, 0.0])), "the odometry jumped by 1.0"),
        (broken(base=np.array([0.0, 0.0, 2.0])), "and 2.00 rad"),
        (lose, "the base does not answer"),
        (kill(signal.SIGINT), "SIGINT"),
        (kill(signal.SIGTERM), "SIGTERM"),
        (kill(signal.SIGHUP), "SIGHUP"),
    ],
)
def test_what_goes_wrong_stops_the_base(scripted, fault, reason):
    fake = FakeRobot(faults={4: fault})
    outcome = run(scripted(), fake)
    assert reason in outcome.reason and outcome.stopped
    assert outcome.steps == len(fake.commands) == 3
    assert fake.calls[-1] == "stop" and fake.now_moving.tolist() == [0.0, 0.0]


def test_a_camera_that_shows_nothing_for_long_stops_the_base(scripted):
    nothing, something = np.zeros((58, 87), dtype=np.float32), np.full((58, 87), 2.0, dtype=np.float32)
    covered = {4: set_image(image=nothing)}
    outcome = run(scripted(), FakeRobot(faults=covered))
    assert outcome.reason == "the depth images have shown nothing for 0.60 s" and outcome.steps == 8
    for_a_moment = covered | {8: set_image(image=something)}
    assert run(scripted(), FakeRobot(faults=for_a_moment)).reason == TIME_OVER


def test_an_odometry_that_turns_around_and_goes_on_after_a_pause_is_none_that_jumps(scripted):
    def turn(fake, state):
        yaw = 2.9 + 0.25 * fake.time / 0.1
        return replace(state, base=np.array([0.05 * fake.time / 0.1, 0.0, math.remainder(yaw, math.tau)]))

    fake = FakeRobot(faults=dict.fromkeys(range(40), turn), work_s={8: 0.35})
    outcome = run(scripted(), fake)
    assert outcome.reason == TIME_OVER and outcome.missed > 2


def test_an_observation_may_be_somewhat_old(scripted):
    fake = FakeRobot(faults=dict.fromkeys(range(40), age(0.49)), image_age_s=0.49)
    assert run(scripted(), fake).reason == TIME_OVER


def test_an_action_that_is_no_number_is_not_sent(scripted):
    fake = FakeRobot()
    good, bad = (0.5, *[0.0] * 9), (0.5, *[0.0] * 8, math.nan)
    outcome = run(scripted(good, good, bad), fake)
    assert "not finite" in outcome.reason and outcome.stopped and outcome.steps == 2
    assert fake.calls[-1] == "stop"


def test_an_error_of_the_program_stops_the_base_too(scripted):
    def fail(fake, state):
        raise KeyError("a defect")

    fake = FakeRobot(faults={3: fail})
    with pytest.raises(KeyError):
        run(scripted(), fake)
    assert fake.calls == ["command", "command", "stop"]


def test_stopping_is_tried_again(scripted):
    class Stubborn(FakeRobot):
        def stop(self):
            super().stop()
            if self.calls.count("stop") < 3:
                raise DeviceLost("busy")

    outcome = run(scripted(), Stubborn(faults={2: lose}))
    assert outcome.reason == "lost: the base does not answer"

    class Gone(FakeRobot):
        def stop(self):
            raise DeviceLost("gone")

    assert run(scripted(), Gone(faults={2: lose})).reason.endswith("could not be told to stand")


def test_a_second_signal_ends_it_at_once(scripted):
    fake = FakeRobot(faults={3: lambda *_: [os.kill(os.getpid(), signal.SIGINT) for _ in range(2)] and None})
    with pytest.raises(KeyboardInterrupt):
        run(scripted(), fake)
    assert fake.calls[-1] == "stop"


def test_who_presses_ctrl_c_again_and_again_does_not_interrupt_stopping(scripted):
    class Slow(FakeRobot):
        def stop(self):
            for _ in range(3):
                os.kill(os.getpid(), signal.SIGINT)
            super().stop()

    fake = Slow(faults={3: kill(signal.SIGINT)})
    assert run(scripted(), fake).reason == "SIGINT" and fake.calls[-1] == "stop"


def test_an_interrupt_just_before_signals_are_ignored_does_not_prevent_stopping(scripted, monkeypatch):
    ignore = StopSignals.ignore
    raised = []

    def late(signals):
        if not raised:
            raised.append(True)
            for _ in range(3):
                os.kill(os.getpid(), signal.SIGINT)
        ignore(signals)

    def fail(fake, state):
        raise KeyError("a defect")

    monkeypatch.setattr(StopSignals, "ignore", late)
    fake = FakeRobot(faults={3: fail})
    with pytest.raises(KeyboardInterrupt):
        run(scripted(), fake)
    assert raised and fake.calls[-1] == "stop" and fake.now_moving.tolist() == [0.0, 0.0]


def test_signals_are_handled_as_before_afterwards(scripted):
    before = signal.getsignal(signal.SIGINT)
    run(scripted(), FakeRobot(), max_s=0.3)
    assert signal.getsignal(signal.SIGINT) == before


# --- the end, the clock -----------------------------------------------------------------------------


def test_arrives_within_the_goals_tolerance(scripted):
    fake = FakeRobot()
    outcome = run(scripted(), fake, max_s=30.0, goal=np.array([1.0, 0.0]))
    assert outcome.reason == ARRIVED and not outcome.stopped
    assert 0.1 < outcome.distance_m <= 0.15 and fake.calls[-1] == "stop"


def test_ticks_are_a_tenth_of_a_second_apart(scripted):
    fake = FakeRobot()
    outcome = run(scripted(), fake, max_s=2.0)
    assert (outcome.reason, outcome.steps, outcome.missed) == (TIME_OVER, 20, 0)
    assert outcome.duration_s == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("work_s", "steps", "missed"),
    [({}, 20, 0), ({5: 0.09}, 20, 0), ({5: 0.11}, 19, 1), ({5: 0.25}, 18, 2), ({5: 0.11, 8: 0.3}, 17, 3)],
)
def test_missed_ticks_are_counted_and_not_made_up_for(scripted, work_s, steps, missed):
    outcome = run(scripted(), FakeRobot(work_s=work_s), max_s=2.0)
    assert (outcome.steps, outcome.missed) == (steps, missed)


def test_what_took_long_is_not_sent(scripted):
    """The image is fresh when it is read, and too old when the network is done."""
    agent, fake = scripted(), FakeRobot()
    network = agent._network
    act = network.__class__.__call__

    class Slow(network.__class__):
        def __call__(self, groups):
            fake.time += 0.6 if len(self.seen) == 2 else 0.0
            return act(self, groups)

    network.__class__ = Slow
    outcome = run(agent, fake)
    assert "old" in outcome.reason and outcome.steps == 2 and fake.calls[-1] == "stop"


def test_the_clock_of_real_robots_waits():
    clock = MonotonicClock()
    start = clock.now()
    clock.sleep_until(start + 0.05)
    assert 0.05 <= clock.now() - start < 1.0
    clock.sleep_until(start)  # has passed


# --- what is refused before anything moves ----------------------------------------------------------


def joints(**changes):
    values = dict(robot.STOWED) | changes
    return np.array([values[name] for name in robot.JOINTS])


def real(**changes):
    return Connection(is_real=True, camera=replace(CAMERA, **changes))


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"start": replace(STATE, homed=False)}, "not homed"),
        ({"start": replace(STATE, runstop=True)}, "runstop"),
        ({"start": replace(STATE, joints=joints(lift=1.2))}, "'lift' is at 1.200, outside"),
        ({"start": replace(STATE, joints=joints(head_pan=math.nan))}, "'head_pan'"),
        ({"start": replace(STATE, base_velocity=np.array([math.nan, 0.0]))}, "not finite"),
        ({"connection": Connection(is_real=True)}, "no depth camera"),
        ({"connection": real(width=80)}, "80 x 58 are smaller"),
        ({"connection": real(mount="landscape")}, "mounted in landscape"),
        ({"connection": real(fov_deg=(69.0, 42.0))}, "69 degrees along its width"),
        ({"connection": real(fov_deg=(87.0, 42.0))}, "42 degrees along its height"),
        ({"image": np.ones((100, 200), dtype=np.float32)}, "gives images of 200 x 100, and said 87 x 58"),
    ],
)
def test_bad_states_are_refused_before_anything_moves(scripted, parts, message):
    fake = FakeRobot(**parts)
    with pytest.raises(ConfigError, match=message) as caught:
        run(scripted(), fake)
    assert "command" not in fake.calls and "\n" not in str(caught.value)


def test_a_slightly_wrong_camera_or_encoder_is_not_refused(scripted):
    fake = FakeRobot(connection=real(fov_deg=(85.0, 57.0)), start=replace(STATE, joints=joints(lift=-0.02)))
    assert run(scripted(), fake).reason == TIME_OVER


@pytest.mark.parametrize("goal", [None, np.array([1.0, math.nan]), np.array([1.0, 2.0, 3.0])])
def test_a_policy_that_drives_needs_a_goal(scripted, goal):
    with pytest.raises(ConfigError, match=r"^goal: "):
        run(scripted(), FakeRobot(), goal=goal)


def test_policies_for_simulation_are_refused_on_real_robots(scripted):
    agent = scripted(simulation_only="it sees through walls")
    with pytest.raises(ConfigError, match="simulation only: it sees through walls"):
        run(agent, FakeRobot(connection=Connection(is_real=True, camera=CAMERA)))
    assert run(agent, FakeRobot(), max_s=0.2).reason == TIME_OVER


def test_groups_that_nobody_tells_are_refused(scripted):
    contract = scripted().contract
    scandots = replace(contract.observations[2], name="scandots", dtype="float32", source="simulation")
    changes = {
        "observations": (*contract.observations[:2], scandots),
        "observation_names": ("proprio", "goal", "scandots"),
    }
    with pytest.raises(ConfigError, match="reads 'scandots'"):
        run(scripted(**changes), FakeRobot())
    told = {"scandots": np.ones((1, scandots.size), dtype=np.float32)}
    assert run(scripted(**changes), FakeRobot(told_groups=told), max_s=0.2).reason == TIME_OVER
