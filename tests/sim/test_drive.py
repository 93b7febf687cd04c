"""The batched robot against C MuJoCo at 1 ms under the same law of motion, written here in NumPy."""

import json
import math
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch
from sim_worlds import restart, scene_with, simulate

from spin_rl import robot
from spin_rl.sim.config import SimConfig
from spin_rl.sim.graph import StepGraph

COMMANDS = json.loads((Path(__file__).parents[1] / "data" / "command_sequence.json").read_text())
ACTIONS = np.array(COMMANDS["actions"])
START = [COMMANDS["start_joints"][joint] for joint in robot.JOINTS]
SHARE = np.array([share for _, share in robot.DOF_SOURCE])
SOURCE = [robot.JOINTS.index(joint) for joint, _ in robot.DOF_SOURCE]
SPAN = SHARE * (np.array(robot.JOINT_UPPER) - np.array(robot.JOINT_LOWER))[SOURCE]


@cache
def native_states(profile_name):
    """States after each action in C MuJoCo, shape (20, 13)."""
    profile = robot.SPEED_PROFILES[profile_name]
    h = 0.001
    model = robot.load_spec().compile()
    model.opt.timestep, model.opt.iterations, model.opt.ls_iterations = h, 100, 50
    data = mujoco.MjData(model)
    data.qpos[:] = robot.qpos_from_joints(model, COMMANDS["start_joints"])
    lower, upper = np.array(robot.JOINT_LOWER), np.array(robot.JOINT_UPPER)
    stowed = np.array([robot.STOWED[joint] for joint in robot.JOINTS])
    speed_max = SHARE * np.array(profile.joint_velocity_max)[SOURCE]
    gain = (1 - math.exp(-h / profile.joint_time_constant)) / h
    blend = 1 - math.exp(-h / profile.base_time_constant)
    forward = turn = 0.0
    states = []
    for action in ACTIONS:
        target = stowed + np.where(
            action[2:] >= 0, action[2:] * (upper - stowed), action[2:] * (stowed - lower)
        )
        forward_target = action[0] * (profile.forward_max if action[0] > 0 else profile.reverse_max)
        turn_target = action[1] * profile.turn_max
        for _ in range(round(COMMANDS["control_period_s"] / h)):
            most, most_turn = profile.base_acceleration * h, profile.turn_acceleration * h
            forward += np.clip((forward_target - forward) * blend, -most, most)
            turn += np.clip((turn_target - turn) * blend, -most_turn, most_turn)
            yaw = data.qpos[2] + 0.5 * h * turn
            data.ctrl[:3] = forward * math.cos(yaw), forward * math.sin(yaw), turn
            data.ctrl[3:] = np.clip((SHARE * target[SOURCE] - data.qpos[3:]) * gain, -speed_max, speed_max)
            mujoco.mj_step(model, data)
        states.append(data.qpos.copy())
    return np.array(states)


def batched_states(config, profile_name, device, nworld=3):
    """States after each action of the captured batched simulation, shape (20, nworld, 13)."""
    sim = simulate([scene_with(joints=START)] * nworld, device, config, profile_name)
    graph = StepGraph(sim.advance, device)
    restart(sim)
    states = []
    for action in ACTIONS:
        sim.views.action[:] = torch.tensor(action, dtype=torch.float32)
        graph.replay()
        states.append(sim.views.qpos.cpu().numpy().copy())
    return np.array(states)


# Measured: joints 0.09 % and 0.43 %, base 0.07 % and 0.31 %, yaw 0.06 % and 0.17 %.
@pytest.mark.parametrize(
    ("timestep", "substeps", "bound"), [(0.02, 5, 0.002), (0.05, 2, 0.005)], ids=["default", "fast"]
)
@pytest.mark.parametrize("profile", robot.SPEED_PROFILES)
def test_motion_agrees_with_native_mujoco(profile, timestep, substeps, bound, device):
    native = native_states(profile)
    batched = batched_states(SimConfig(timestep=timestep, substeps=substeps), profile, device)
    np.testing.assert_array_equal(batched, batched[:, :1].repeat(3, axis=1))

    error = np.abs(batched[:, 0] - native)
    worst = dict(zip(robot.DOF_NAMES[3:], error[:, 3:].max(0) / SPAN, strict=True))
    assert max(worst.values()) < bound, worst
    steps = np.diff(native[:, :3], axis=0, prepend=np.zeros((1, 3)))
    travel, turned = np.linalg.norm(steps[:, :2], axis=1).sum(), np.abs(steps[:, 2]).sum()
    assert travel > 0.1 and turned > 0.5
    assert np.linalg.norm(batched[:, 0, :2] - native[:, :2], axis=1).max() < bound * travel
    assert error[:, 2].max() < bound * turned


def test_speed_scale_and_lag_of_a_world_are_its_own(device):
    sim = simulate([scene_with(joints=START)] * 3, device)
    sim.dynamics.speed_scale.assign(np.array([1.0, 0.5, 1.0], np.float32))
    sim.dynamics.lag.assign(np.array([[0.15, 0.1], [0.15, 0.1], [0.6, 0.1]], np.float32))
    graph = StepGraph(sim.advance, device)
    restart(sim)
    sim.views.action[:] = 0.0
    sim.views.action[:, 0] = 1.0
    for _ in range(20):
        graph.replay()
    speed = sim.views.base_velocity[:, 0].cpu().numpy()
    fastest = robot.SPEED_PROFILES["paper"].forward_max
    assert speed[:2] == pytest.approx([fastest, 0.5 * fastest], rel=1e-3)
    # So slow a base stays below the acceleration limit.
    assert speed[2] == pytest.approx(fastest * (1 - math.exp(-2.0 / 0.6)), rel=1e-3)


@pytest.mark.parametrize("action", [0, 1], ids=["forward", "turn"])
def test_the_base_speeds_up_at_its_limit_times_the_worlds_scale(action, device):
    """With a short lag, over 0.1 s: half of the limit is far from the top speed."""
    scales = np.array([1.0, 0.5, 0.25], np.float32)
    sim = simulate([scene_with(joints=START)] * 3, device)
    sim.dynamics.acceleration_scale.assign(0.5 * scales)
    sim.dynamics.lag.assign(np.full((3, 2), 0.01, np.float32))
    graph = StepGraph(sim.advance, device)
    restart(sim)
    sim.views.action[:] = 0.0
    sim.views.action[:, action] = 1.0
    graph.replay()
    profile = robot.SPEED_PROFILES["paper"]
    limit = (profile.base_acceleration, profile.turn_acceleration)[action]
    gained = sim.views.base_velocity[:, action].cpu().numpy()
    np.testing.assert_allclose(gained, 0.5 * scales * limit * COMMANDS["control_period_s"], rtol=1e-4)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_joints_move_at_their_top_speed_times_the_worlds_scale(way, device):
    """From the middle of their ranges to one end: all are still under way after 0.1 s."""
    scales = np.array([1.0, 0.5, 0.8], np.float32)
    middle = 0.5 * (np.array(robot.JOINT_LOWER) + np.array(robot.JOINT_UPPER))
    sim = simulate([scene_with(joints=middle)] * 3, device)
    sim.dynamics.speed_scale.assign(scales)
    graph = StepGraph(sim.advance, device)
    restart(sim)
    sim.views.action[:, :2] = 0.0
    sim.views.action[:, 2:] = way
    graph.replay()
    top = SHARE * np.array(robot.SPEED_PROFILES["paper"].joint_velocity_max)[SOURCE]
    speeds = sim.views.qvel[:, 3:].cpu().numpy()
    np.testing.assert_allclose(speeds / (way * top), scales[:, None].repeat(len(top), 1), rtol=5e-3)


def test_actions_beyond_the_range_are_those_at_its_ends(device):
    sim = simulate([scene_with()] * 2, device)
    sim.views.action[0], sim.views.action[1] = 1.0, 7.0
    graph = StepGraph(sim.advance, device)
    for _ in range(5):
        graph.replay()
    qpos = sim.views.qpos.cpu().numpy()
    np.testing.assert_array_equal(qpos[0], qpos[1])
    assert (np.abs(qpos[0]) > 0.01).all()
