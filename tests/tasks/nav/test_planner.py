"""The planner over what was seen, and the way out of where the robot is stuck."""

from dataclasses import replace

import numpy as np
import pytest
import torch
import warp as wp

from spin_rl import robot
from spin_rl.config import ConfigError, from_keys
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.tasks.common import episode
from spin_rl.tasks.common.config import ScandotsConfig
from spin_rl.tasks.nav.config import GuardConfig, NavConfig, PlannerConfig

BOX = PoolSpec().first_box
GUARDED = NavConfig(guard=GuardConfig(enabled=True), scandots=ScandotsConfig(pieces_from_m=0.3))
PLANNED = replace(GUARDED, planner=PlannerConfig(enabled=True))
WALL = ((1.4, 0.0, 0.5), (0.05, 1.2, 0.5))


def scene_with(*boxes, goal=(4.0, 0.0), yaw=0.0) -> Scene:
    """Boxes, each (position, half size), around a robot at the origin that looks ahead and down."""
    scene = Scene.empty(PoolSpec())
    scene.goal[:], scene.start[2] = goal, yaw
    scene.start_joints[-2:] = (0.0, -0.5)
    for slot, (pos, half) in enumerate(boxes, BOX):
        scene.active[slot] = True
        scene.pos[slot], scene.half_size[slot] = pos, half
    return scene


def drive(env, command, steps, joints=None):
    """Command the base, with the joints where they started unless given; return how the episode ended."""
    action = env.sim.views.action.clone()
    action[:, :2] = torch.tensor(command)
    if joints is not None:
        action[:, 2:8] = torch.tensor(joints)
    for _ in range(steps):
        env.step(action)
        if int(env.outcome[0]) != episode.RUNNING:
            return int(env.outcome[0])
    return None


def seen_goal(env) -> np.ndarray:
    """Where the policy takes the goal to be, in the world, from its observation."""
    x, y = 2.5 * env.get_observations()["goal"][0, :2].cpu().numpy()
    base = env.sim.views.qpos[0, :3].cpu().numpy()
    c, s = np.cos(base[2]), np.sin(base[2])
    return base[:2] + (c * x - s * y, s * x + c * y)


@pytest.mark.parametrize(
    ("goal", "subgoal"),
    [((1.5, 0.4), (1.5, 0.4)), ((4.0, 0.0), (2.0, 0.0)), ((0.0, -5.0), (0.0, -2.0)), ((-3.0, 3.0), None)],
)
def test_on_a_free_floor_the_way_is_straight(make_nav_env, goal, subgoal):
    env = make_nav_env(PLANNED, num_envs=1, scene=scene_with(goal=goal))
    at = seen_goal(env)
    wanted = 2.0 * np.array(goal) / np.linalg.norm(goal) if subgoal is None else subgoal
    np.testing.assert_allclose(at, wanted, atol=0.15)
    np.testing.assert_allclose(env.planner.subgoal[0].cpu(), at, atol=1e-4)


def test_the_way_leads_around_what_is_seen_and_through_what_is_not(make_nav_env):
    seeing = make_nav_env(PLANNED, num_envs=1, scene=scene_with(WALL))
    for _ in range(8):  # it is told of news after half a second
        seeing.step(seeing.sim.views.action.clone())
    assert abs(seen_goal(seeing)[1]) > 0.8
    # Behind the robot the same wall is not seen.
    blind = make_nav_env(PLANNED, num_envs=1, scene=scene_with(WALL, yaw=np.pi))
    for _ in range(8):
        blind.step(blind.sim.views.action.clone())
    np.testing.assert_allclose(seen_goal(blind), (2.0, 0.0), atol=0.15)
    # Once it has turned around, it is.
    drive(blind, (0.0, 1.0), 25)
    assert abs(seen_goal(blind)[1]) > 0.8
    assert make_nav_env(GUARDED, num_envs=1, scene=scene_with(WALL)).planner is None


def test_a_new_episode_forgets_the_map(make_nav_env):
    env = make_nav_env(PLANNED, num_envs=2, scene=scene_with(WALL))
    for _ in range(8):
        env.step(env.sim.views.action.clone())
    assert (env.planner.subgoal[:, 1].abs() > 0.8).all()
    layout = env.sim.layout
    layout.active.assign(np.zeros(layout.active.shape, dtype=bool))
    env.reset_worlds(torch.tensor([True, False], device=env.device))
    env.step(env.sim.views.action.clone())
    np.testing.assert_allclose(env.planner.subgoal[0].cpu(), (2.0, 0.0), atol=0.1)
    assert abs(float(env.planner.subgoal[1, 1])) > 0.8


def test_worlds_that_start_anew_do_not_make_others_plan_sooner(make_nav_env):
    def told_after(others_start):
        env = make_nav_env(PLANNED, num_envs=2, scene=scene_with(WALL))
        active = env.sim.layout.active
        there = active.numpy().copy()
        active.zero_()
        env.reset()
        active.assign(there)  # news from the first step on
        for step in range(1, 12):
            env.step(env.sim.views.action.clone())
            if abs(float(env.planner.subgoal[1, 1])) > 0.8:
                return step
            if others_start:
                env.reset_worlds(torch.tensor([True, False], device=env.device))
        return None

    assert told_after(others_start=True) == told_after(others_start=False) == 5


def test_where_no_way_is_known_the_goal_itself_is_told(make_nav_env):
    inside = scene_with(((1.2, 0.0, 0.3), (0.3, 0.3, 0.3)), goal=(1.2, 0.0))
    env = make_nav_env(PLANNED, num_envs=1, scene=inside)
    for _ in range(8):
        env.step(env.sim.views.action.clone())
    np.testing.assert_allclose(seen_goal(env), (1.2, 0.0), atol=1e-3)


def test_a_robot_that_pushes_on_is_driven_out(make_nav_env):
    """A policy that always drives ahead stands before a wall for ever, unless it is led around it."""
    aside = []
    for cfg in (GUARDED, PLANNED):
        env = make_nav_env(cfg, num_envs=1, scene=scene_with(WALL, goal=(6.0, 0.0)))
        assert drive(env, (0.5, 0.0), 45) is None
        assert 0.8 < float(env.sim.views.qpos[0, 0]) < 1.4
        assert drive(env, (0.5, 0.0), 40) is None
        aside.append(abs(float(env.sim.views.qpos[0, 1])))
    assert aside[0] < 0.1 and aside[1] > 0.2


def test_a_robot_that_stands_of_itself_is_driven_too_after_twice_the_time(make_nav_env):
    env = make_nav_env(PLANNED, num_envs=1, scene=scene_with(goal=(3.0, 0.0)))
    drive(env, (0.0, 0.0), 29)
    assert not env.guard.guarded[0] and float(env.sim.views.qpos[0, 0]) < 0.01
    drive(env, (0.0, 0.0), 25)
    assert env.guard.guarded[0] and float(env.sim.views.qpos[0, 0]) > 0.3


def test_the_arm_keeps_still_while_the_guard_drives(make_nav_env):
    env = make_nav_env(PLANNED, num_envs=1, scene=scene_with(goal=(3.0, 0.0)))
    drive(env, (0.0, 0.0), 32)
    assert env.guard.guarded[0]
    arm = slice(3, 3 + len(robot.DOF_NAMES[3:11]))
    before = env.sim.views.qpos[0, arm].clone()
    drive(env, (0.0, 0.0), 20, joints=(1.0, 1.0, -1.0, 0.5, 0.5, 0.5))
    assert env.guard.guarded[0]
    torch.testing.assert_close(env.sim.views.qpos[0, arm], before, atol=0.02, rtol=0.0)


def test_a_recovery_ends_with_the_episode(make_nav_env):
    env = make_nav_env(PLANNED, num_envs=1, scene=scene_with(goal=(3.0, 0.0)))
    drive(env, (0.0, 0.0), 35)
    assert env.guard.guarded[0]
    env.reset()
    drive(env, (0.0, 0.0), 2)
    assert not env.guard.guarded[0]


def test_planning_is_the_same_in_a_graph_and_without(make_nav_env):
    subgoals = []
    for capture in (True, False):
        env = make_nav_env(PLANNED, num_envs=4, seed=5, capture=capture)
        generator = torch.Generator().manual_seed(2)
        for _ in range(15):
            env.step((2.0 * torch.rand(4, 10, generator=generator) - 1.0).to(env.device))
        subgoals.append(env.planner.subgoal.clone())
    torch.testing.assert_close(*subgoals)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PlannerConfig(blocked_m=0.05), "task.planner.blocked_m"),
        (lambda: from_keys(PlannerConfig, {"replan_s": 0.0}, "task.planner"), "task.planner.replan_s"),
    ],
)
def test_settings_that_cannot_be_meant_are_named(make, message):
    with pytest.raises(ConfigError, match=message):
        make()


def test_the_planner_needs_the_guard(make_nav_env):
    with pytest.raises(ConfigError, match=r"^task\.planner\.enabled"):
        make_nav_env(NavConfig(planner=PlannerConfig(enabled=True)), num_envs=1)


def test_the_plan_is_that_of_all_values_around_the_robot(make_nav_env):
    """What the planner leaves out is farther from the goal than the robot by more than it needs."""
    env = make_nav_env(PLANNED, num_envs=8, seed=11)
    fields = env.planner._distance_field
    some = fields.field.values.numpy().copy()
    near = fields.near.numpy()
    fields.near = wp.zeros(0, dtype=wp.int32, device=env.device)
    fields.update(env.sim.layout.goal, wp.full(8, True, dtype=bool, device=env.device))
    every = fields.field.values.numpy()
    grid = np.stack(np.indices(every.shape[1:]), -1)
    for world in range(8):
        mine = every[world].reshape(-1)[near[world]]
        straight = 0.15 * np.linalg.norm(grid - np.unravel_index(near[world], every.shape[1:]), axis=-1)
        needed = every[world] + straight < mine + 1.0
        np.testing.assert_allclose(some[world][needed], every[world][needed], atol=0.02)
        assert 20 < needed.sum() < every[world].size
    assert (some > every + 1.0).any()
