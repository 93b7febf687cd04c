"""What a robot is told: targets as the file says, within limits, without jumps."""

from dataclasses import replace

import numpy as np
import pytest

from spin_rl import robot
from spin_rl.deploy.decoder import Decoder

STOWED = np.array([robot.STOWED[joint] for joint in robot.JOINTS])
LOW, HIGH = np.array(robot.JOINT_LOWER), np.array(robot.JOINT_UPPER)
FINGER = robot.JOINTS.index("gripper_finger")


def action(base=(0.0, 0.0), joints=0.0):
    return np.array([*base, *np.broadcast_to(joints, 8)])


@pytest.fixture
def absolute(nav_network):
    decoder = Decoder(nav_network.contract)
    decoder.reset(STOWED)
    return decoder


@pytest.fixture
def increments(pick_network):
    decoder = Decoder(pick_network.contract)
    decoder.reset(STOWED)
    return decoder


@pytest.mark.parametrize(
    ("value", "target"), [(0.0, STOWED), (1.0, HIGH), (-1.0, LOW), (9.0, HIGH), (0.5, (STOWED + HIGH) / 2)]
)
def test_absolute_targets_are_linear_between_limits_and_stowed(absolute, value, target):
    command = absolute(action(joints=value), STOWED)
    np.testing.assert_allclose(command.joints, target, atol=1e-9)
    np.testing.assert_allclose(command.joint_speed, robot.SPEED_PROFILES["paper"].joint_velocity_max)


@pytest.mark.parametrize("pose", [STOWED, LOW, HIGH, (LOW + HIGH) / 2, HIGH + 0.02])
def test_the_holding_action_holds(absolute, pose):
    command = absolute(absolute.holding(pose), pose)
    np.testing.assert_allclose(command.joints, np.clip(pose, LOW, HIGH), atol=1e-9)
    assert (command.forward, command.turn) == (0.0, 0.0)
    for joint, value, share in zip(robot.JOINTS, pose, absolute.holding(pose)[2:], strict=True):
        assert share == pytest.approx(np.clip(robot.action_of(joint, value), -1.0, 1.0), abs=1e-9)


def test_the_base_speeds_up_and_slows_down_within_its_acceleration(absolute):
    profile = robot.SPEED_PROFILES["paper"]
    steps = [(1.0, 1.0)] * 8 + [(-1.0, -1.0)] * 12
    speeds = np.array([[c.forward, c.turn] for c in (absolute(action(base), STOWED) for base in steps)])
    changes = np.abs(np.diff(np.vstack([np.zeros(2), speeds]), axis=0)).max(0)
    np.testing.assert_allclose(changes, [0.1 * profile.base_acceleration, 0.1 * profile.turn_acceleration])
    np.testing.assert_allclose(speeds.max(0), [profile.forward_max, profile.turn_max])
    np.testing.assert_allclose(speeds.min(0), [-profile.reverse_max, -profile.turn_max])


def test_everything_is_slower_by_the_speed_scale(nav_network):
    decoder = Decoder(nav_network.contract, speed_scale=0.25)
    commands = [decoder(action((1.0, -1.0)), STOWED) for _ in range(20)]
    assert (commands[-1].forward, commands[-1].turn) == pytest.approx((0.2, -0.375))
    fastest = np.array(robot.SPEED_PROFILES["paper"].joint_velocity_max)
    np.testing.assert_allclose(commands[-1].joint_speed, 0.25 * fastest)
    for scale in (0.0, 1.1, float("nan")):
        with pytest.raises(ValueError, match="speed_scale"):
            Decoder(nav_network.contract, speed_scale=scale)


def test_a_reset_forgets_the_speed(absolute):
    for _ in range(5):
        absolute(action((1.0, 0.0)), STOWED)
    absolute.reset(STOWED)
    assert absolute(action((1.0, 0.0)), STOWED).forward == pytest.approx(0.2)


def test_increments_move_targets_and_keep_them_near_the_joints(increments, pick_network):
    rate = np.array(pick_network.contract.actions.joint_rate)
    lead = np.array(pick_network.contract.actions.joint_lead)
    rates_seen = []
    for _ in range(4):  # the joints stand still
        before = increments.target
        rates_seen.append((increments(action(joints=1.0), STOWED).joints - before) / 0.1)
    moving = [i for i in range(8) if i != FINGER]
    first = np.minimum(rate * 0.1, HIGH - STOWED) / 0.1
    np.testing.assert_allclose(rates_seen[0][moving], first[moving], atol=1e-9)
    np.testing.assert_allclose(increments.target, np.minimum(STOWED + lead, HIGH), atol=1e-9)
    assert increments(action(joints=0.0), HIGH).joints[FINGER] == pytest.approx(0.36)  # 0.35, led by 0.24


def test_increments_hold_with_the_fingers_action(increments):
    pose = STOWED.copy()
    pose[FINGER] = 0.5
    increments.reset(pose)
    hold = increments.holding(pose)
    assert hold.tolist() == pytest.approx([0.0] * 7 + [0.25, 0.0, 0.0])
    np.testing.assert_allclose(increments(hold, pose).joints, pose, atol=1e-9)


def test_picking_backs_up_as_fast_as_it_drives(increments):
    speeds = [increments(action((-1.0, 0.0)), STOWED).forward for _ in range(3)]
    assert speeds[-1] == pytest.approx(-0.2)


@pytest.mark.parametrize("place", [0, 5])
def test_actions_that_are_no_numbers_are_refused(absolute, place):
    bad = action()
    bad[place] = np.inf
    with pytest.raises(ValueError, match="not finite"):
        absolute(bad, STOWED)


def test_a_frozen_camera_stays_where_it_is(scripted):
    from fake_robot import STATE

    from spin_rl.deploy.agent import Inputs

    agent = scripted((0.0,) * 8 + (1.0, 1.0))
    pose = (-0.5, -0.9)
    frozen = scripted((0.0,) * 8 + (1.0, 1.0), camera=replace(agent.contract.camera, pose=pose))
    image = np.full((87, 58), 1.0, dtype=np.float32)
    for one, wanted in ((agent, HIGH[-2:]), (frozen, pose)):
        one.reset(STATE, np.zeros(2))
        used, command = one.act(Inputs(STATE, image))
        np.testing.assert_allclose(command.joints[-2:], wanted)
        assert [robot.action_of(j, p) for j, p in zip(robot.CAMERA_JOINTS, wanted, strict=True)] == (
            pytest.approx(used[-2:].tolist())
        )
