"""The runtime beside the environments: told and commanded the same as in training, step by step."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import warp as wp

from spin_rl.deploy.agent import Agent, Inputs
from spin_rl.deploy.backends.mujoco import MujocoRobot
from spin_rl.deploy.interface import RobotState
from spin_rl.deploy.network import Network
from spin_rl.export.describe import describe
from spin_rl.models.pointnet import NUM_FLAGS, TOKEN_DIM
from spin_rl.runners.policy_file import read_policy
from spin_rl.sensors.depth.filter_config import DepthFilterConfig
from spin_rl.sensors.depth.pipeline import DepthConfig
from spin_rl.tasks.common.proprioception import joints
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.pick.config import PickConfig
from spin_rl.tasks.pick.env import PickEnv

DATA = Path(__file__).parents[1] / "data"
NUM_STEPS, WORLD = 12, 1


class Recorder:
    """A network that acts as it is told, and keeps what it was told."""

    def __init__(self, contract):
        self.contract, self.action, self.groups = contract, np.zeros(10), {}

    def reset(self):
        pass

    def __call__(self, groups):
        self.groups = groups
        return self.action


def state_of(env):
    """What a robot would measure in one world."""
    qpos, qvel = (view[WORLD].cpu().double().numpy() for view in (env.sim.views.qpos, env.sim.views.qvel))
    at, moving = (
        joints(view)[WORLD].cpu().double().numpy() for view in (env.sim.views.qpos, env.sim.views.qvel)
    )
    forward = qvel[0] * np.cos(qpos[2]) + qvel[1] * np.sin(qpos[2])
    return RobotState(0.0, at, moving, qpos[:3], np.array([forward, qvel[2]]))


def steps(env, network, goal=None, object_b=None, seed=0):
    """Act at random in all worlds, a robot beside one of them; yield its groups and the environment's."""
    rng = np.random.default_rng(seed)
    recorder = Recorder(network)
    agent = Agent(recorder)
    obs = env.reset()
    agent.reset(state_of(env), goal(env) if goal else None, object_b(env) if object_b else None)
    for _ in range(NUM_STEPS):
        recorder.action = rng.uniform(-0.6, 1.0, 10)
        measured = env.depth.pipeline.noise.depth.numpy()[WORLD]
        action, command = agent.act(Inputs(state_of(env), measured))
        yield recorder.groups, {name: obs[name][WORLD].cpu().numpy() for name in recorder.groups}
        obs, _, dones, _ = env.step(torch.tensor(np.tile(action, (env.num_envs, 1)), dtype=torch.float32))
        if dones[WORLD]:
            return
        target = env.sim.views.target[WORLD].cpu().numpy()
        np.testing.assert_allclose(command.joints, target, atol=2e-6)


def assert_same(ours, theirs):
    for name, values in ours.items():
        if name == "depth":  # a level is 1/255 of the range; rounding may fall to the other side
            levels = np.abs(values[0].astype(int) - theirs[name].astype(int))
            assert levels.max() <= 1 and (levels > 0).mean() < 1e-3
        else:
            np.testing.assert_allclose(values[0], theirs[name], atol=1e-5, err_msg=name)


def with_filter(network, filter_config):
    """The contract of a file, for a camera with these steps of the filter."""
    return replace(network.contract, depth_filter=filter_config)


EVERY_STEP = DepthFilterConfig(
    dilate_px=1, close_px=4, fill_px=3, median_support=2, blur=0.5, memory=0.4, hold_steps=3
)


@pytest.mark.parametrize("goal_range_m", [None, 1.5])
def test_a_robot_that_drives_is_told_what_policies_are_told_in_training(make_nav_env, goal_range_m):
    config = NavConfig(
        depth=DepthConfig(filter=EVERY_STEP), goal_range_m=goal_range_m, stop_on_collision=False
    )
    env = make_nav_env(config, num_envs=2, seed=5)
    contract = with_filter(Network(DATA / "tiny_nav.onnx"), EVERY_STEP)
    contract = replace(contract, goal=replace(contract.goal, range_m=goal_range_m))
    count = 0
    for ours, theirs in steps(env, contract, goal=goal_of):
        assert set(ours) == {"proprio", "goal", "depth"}
        assert_same(ours, theirs)
        count += 1
    assert count > 5


def goal_of(env):
    return wp.to_torch(env.sim.layout.goal)[WORLD].cpu().double().numpy()


def object_in_base(env):
    """Where the object is at the start, in the frame of the base."""
    point = env.sim.object.views.start_pose[WORLD, :3].cpu().double().numpy()
    x, y, yaw = env.sim.views.qpos[WORLD, :3].cpu().double().numpy()
    c, s = np.cos(yaw), np.sin(yaw)
    dx, dy = point[0] - x, point[1] - y
    return np.array([c * dx + s * dy, c * dy - s * dx, point[2]])


@pytest.mark.slow
def test_a_robot_that_picks_is_told_what_policies_are_told_in_training(device):
    filter_config = DepthFilterConfig(near_m=0.2, far_m=1.6)
    env = PickEnv(PickConfig(depth=DepthConfig(filter=filter_config)), 2, device, 3)
    contract = with_filter(Network(DATA / "tiny_pick.onnx"), filter_config)
    count = 0
    for ours, theirs in steps(env, contract, object_b=object_in_base):
        assert {"hand", "object_start", "object_at_start", "hand_in_image"} < set(ours)
        assert_same(ours, theirs)
        count += 1
    assert count > 5


def test_scandots_in_c_mujoco_are_those_of_training(make_nav_env):
    env = make_nav_env(num_envs=2, seed=6)
    env.set_cells([0, 0], [2, 2])
    obs = env.reset()
    policy = read_policy("nav-cvo")
    one = MujocoRobot(env.sim.layout.scene(WORLD), describe(policy, units=256))
    told = one.told()["scandots"].reshape(-1, TOKEN_DIM)
    wanted = obs["scandots"][WORLD].cpu().numpy().reshape(-1, TOKEN_DIM)
    seen = wanted[wanted[:, -NUM_FLAGS:].any(-1)]
    assert told.shape == (16, TOKEN_DIM) and 2 <= len(seen) < 16
    assert not told[len(seen) :].any()
    order = [np.abs(seen - token).max(-1).argmin() for token in told[: len(seen)]]
    assert sorted(order) == list(range(len(seen)))
    np.testing.assert_allclose(told[: len(seen)], seen[order], atol=1e-5)
    np.testing.assert_allclose(one.state().joints, joints(env.sim.views.qpos)[WORLD].cpu(), atol=1e-6)
