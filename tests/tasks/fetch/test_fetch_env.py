"""Stages of a fetch: what leads from one to the next, what ends it, and what the scripts do."""

import math

import numpy as np
import pytest
import torch
from fetch_worlds import (
    ALIGN,
    CARRY,
    NUM_WORLDS,
    PICK,
    PLACE,
    REACH,
    RETRACT,
    enter,
    idle,
    put_object,
    stand_at,
    state,
    table_yaw,
)

from spin_rl import robot
from spin_rl.deploy.fetch.numbers import RELEASE_PHASE
from spin_rl.scenes.objects.shapes import OBJECTS
from spin_rl.sim.targets import ABSOLUTE, INCREMENTAL
from spin_rl.tasks.common import episode
from spin_rl.tasks.fetch.config import STAGES
from spin_rl.tasks.fetch.env import FetchEnv
from spin_rl.tasks.fetch.state import FETCH_OUTCOMES

DROPPED = FETCH_OUTCOMES.index("dropped")


@pytest.fixture(scope="module")
def shared_env(make_fetch_env):
    return make_fetch_env(seed=3)


@pytest.fixture
def env(shared_env) -> FetchEnv:
    """Four fetches at their start; a test may do anything to them."""
    shared_env.set_cells([1, 2, 1, 2], [0] * NUM_WORLDS)
    shared_env.set_objects(["any"] * NUM_WORLDS)
    shared_env.reseed(3)
    shared_env.reset()
    shared_env.episode_stats()
    return shared_env


def test_starts_in_reach_with_the_groups_of_both_policies(env):
    obs = env.get_observations()
    slots = env.sim.layout.pool.num_slots
    widths = {
        "proprio": 31, "goal": 3, "scandots": 32 * slots, "scandots_all": 32 * slots, "hand": 7,
        "object_start": 3, "object": 10, "object_at_start": 10,
        "privileged": 40, "stage": 1,
    }  # fmt: skip
    assert {name: value.shape[1] for name, value in obs.items()} == widths
    assert (env.stage == REACH).all() and (env.sim.views.mode == ABSOLUTE).all()
    assert not env.results().ended.any()


def test_reaching_the_stand_point_begins_align_in_that_world_alone(env):
    stand_at(env, env.goal[1], 1)
    env.step(idle(env))
    assert env.stage.tolist() == [REACH, ALIGN, REACH, REACH]
    assert state(env, "reached").tolist() == [False, True, False, False]


def test_touching_a_wall_while_driving_ends_the_fetch(env):
    stand_at(env, env.goal[2] + torch.tensor([0.0, 0.45]), 2)
    env.step(idle(env))
    assert env.outcome[2] == episode.COLLISION
    result = env.results()
    assert result.cause(2).startswith("reach collision") and "base" in result.cause(2)
    assert result.ended.tolist() == [False, False, True, False]


def test_align_hands_over_within_the_pick_tasks_range(env):
    for world in range(NUM_WORLDS):
        goal = env.goal[world]
        along = torch.tensor([math.cos(table_yaw(env, world)), math.sin(table_yaw(env, world))])
        stand_at(env, goal - 0.1 * along, world, table_yaw(env, world) + 0.3 * (-1) ** world)
    handed_over = torch.zeros(NUM_WORLDS, dtype=torch.bool)
    for _ in range(250):
        obs, _, done, _ = env.step(idle(env))
        assert not done.any()
        for world in torch.nonzero((env.stage == PICK) & ~handed_over)[:, 0].tolist():
            handed_over[world] = True
            at = obs["object"][world]
            assert at[0] == 1.0, "the object is in sight"
            assert abs(at[1]) < 0.1
            low, high = 0.57, 0.85
            assert low < -at[2] < high
            np.testing.assert_allclose(obs["object_start"][world], at[1:4], atol=1e-4)  # seen a step before
            # The hand is beside the table, over the object's height.
            offset = (
                env.sim.object.views.pos[world]
                - env.sim.views.site_pos[world][env.sim.mj_model.site(robot.GRASP_CENTER_SITE).id]
            )
            assert -0.25 < offset[2] < 0.0
            assert env.sim.views.mode[world] == INCREMENTAL
            action = env.sim.views.action[world]
            assert (action[:7] == 0).all() and (action[8:] == 0).all()
        if handed_over.all():
            break
    assert handed_over.all()
    assert (state(env, "retries") == 0).all()


def test_a_pick_out_of_time_is_tried_once_more_and_then_fails(env):
    world, limit = 0, round(env.cfg.limits.pick / 0.1)
    stand_at(env, env.goal[world], world, table_yaw(env, world) + math.pi)
    enter(env, PICK, world)
    state(env, "time")[world] = limit - 1
    state(env, "is_found")[world] = True
    env.step(idle(env))
    assert env.stage[world] == ALIGN and state(env, "retries")[world] == 1
    assert not state(env, "is_found")[world], "it looks anew, and has its back to the table"
    enter(env, PICK, world)
    state(env, "time")[world] = limit - 1
    env.step(idle(env))
    assert env.outcome[world] == episode.TIMEOUT
    result = env.results()
    assert result.cause(world) == "pick timeout"
    assert result.retries[world] == 1 and not result.picked[world]
    assert env.stage[world] == REACH, "a new fetch has begun"


@pytest.mark.parametrize("stage", [ALIGN, PICK])
def test_an_object_on_the_floor_is_lost(env, stage):
    world = 3
    stand_at(env, env.goal[world], world)
    put_object(env, [0.0, 0.0, 0.1], world)
    enter(env, stage, world)
    env.step(idle(env))
    assert env.outcome[world] == DROPPED
    assert env.results().cause(world) == f"{STAGES[stage]} dropped"


def test_a_drop_onto_the_table_is_picked_again_and_one_beside_it_is_not(env):
    for world in (0, 1):
        stand_at(env, env.goal[world], world)
        enter(env, RETRACT, world)
    put_object(env, [0.0, 0.0, 1.0], 1)
    for step in range(3):
        assert env.stage[:2].tolist() == [RETRACT, RETRACT], step
        env.step(idle(env))
    assert env.stage[0] == ALIGN
    assert state(env, "drops")[0] == 1 and state(env, "retries")[0] == 1
    assert env.outcome[1] == DROPPED
    assert env.results().drops[:2].tolist() == [0, 1]


def test_carrying_back_to_the_start_begins_place_with_the_goal_moved(env):
    world = 2
    home = state(env, "home")[world].clone()
    drawn = env.sim.layout.goal.numpy().copy()
    np.testing.assert_allclose(home, env.sim.layout.start.numpy()[world, :2], atol=1e-6)
    stand_at(env, env.goal[world], world)
    enter(env, RETRACT, world, phase=4)
    state(env, "ready")[world] = True
    state(env, "phase_time")[world] = 10
    # Folded and waiting: the pose of the last phase is the stowed one.
    joints = [robot.STOWED[name] for name in robot.JOINTS]
    env.sim.views.target[world] = torch.tensor(joints)
    env.sim.views.target[world, 5] = -0.05
    env.step(idle(env))
    assert env.stage[world] == CARRY
    np.testing.assert_allclose(env.goal[world], home)
    np.testing.assert_array_equal(env.sim.layout.goal.numpy(), drawn, "the scene stays what it was")
    stand_at(env, home + torch.tensor([0.1, 0.0]), world)
    env.step(idle(env))
    assert env.stage[world] == PLACE


@pytest.mark.parametrize(("distance", "succeeds"), [(0.3, True), (0.7, False)])
def test_an_object_at_rest_near_the_start_ends_the_fetch(env, distance, succeeds):
    world = 0
    home = state(env, "home")[world]
    stand_at(env, home + torch.tensor([0.0, 0.0]), world, 0.0)
    enter(env, PLACE, world, phase=int(RELEASE_PHASE) + 1)
    state(env, "mark")[world] = 0.05
    env.sim.views.target[world, 0] = 0.35
    height = float(env.sim.object.views.half_extents[world, 2])
    put_object(env, [float(home[0]) - distance, float(home[1]), height + 0.001], world)
    outcomes = []
    for _ in range(10):
        env.step(idle(env))
        outcomes.append(int(env.outcome[world]))
    assert (episode.SUCCESS in outcomes) == succeeds
    assert env.results().placed[world] == succeeds


def test_carrying_takes_base_head_and_lift_from_the_policy_alone(env):
    """One world carries and another drives to the table, with the same actions."""
    carry, reach = 1, 3
    enter(env, CARRY, carry)
    lift, finger = robot.JOINTS.index("lift"), robot.JOINTS.index("gripper_finger")
    lowest = env.cfg.carry_lift_m
    target = env.sim.views.target
    target[carry, lift] = lowest - 0.005
    before, at = target.clone(), env.sim.views.qpos.clone()
    env.step(torch.full((NUM_WORLDS, 10), 0.8))
    moved = (target - before).abs()
    for name in ("arm_extension", "wrist_yaw", "wrist_pitch", "wrist_roll"):
        joint = robot.JOINTS.index(name)
        assert moved[carry, joint] < 1e-5 and moved[reach, joint] > 0.1, name
    for name in ("head_pan", "head_tilt"):
        joint = robot.JOINTS.index(name)
        assert target[carry, joint] == pytest.approx(float(target[reach, joint]), abs=1e-5), name
        assert moved[carry, joint] > 0.1, name
    driven = env.sim.views.qpos[carry, :3] - at[carry, :3]
    assert driven[:2].norm() > 5e-3 and driven[2] > 5e-3
    assert target[carry, finger] < at[carry, 9:11].mean() - 0.05 and target[reach, finger] > 0.3
    # The lift follows slowly, and not below its limit: from above it stops there.
    assert lowest < target[carry, lift] < lowest + 0.02 and target[reach, lift] > 0.9
    env.step(torch.full((NUM_WORLDS, 10), -1.0))
    assert target[carry, lift] == pytest.approx(lowest, abs=1e-5) and target[reach, lift] < 0.1


def test_the_pick_policy_cannot_drive_into_walls(env):
    """The same push from the same place to the same wall: without the bumper, while it drives, it hits."""
    pick, drive = 0, 2
    start = env.goal[[pick, drive]].clone()
    for world, point in zip((pick, drive), start, strict=True):
        stand_at(env, point, world, table_yaw(env, world) + 0.5 * math.pi)
    enter(env, PICK, pick)
    env.goal[drive] += 10.0  # or it would have reached it
    action = idle(env)
    action[:, 0] = 1.0
    outcomes = []
    for _ in range(40):
        env.step(action)
        outcomes.append(env.outcome[[pick, drive]].tolist())
    assert [outcome for outcome, _ in outcomes] == [episode.RUNNING] * 40
    assert episode.COLLISION in [outcome for _, outcome in outcomes]
    ahead = env.sim.views.qpos[pick, :2] - start[0]
    assert 0.2 < float(ahead.norm()) < 0.5 - 0.059, "it stops short of the wall"


def test_a_base_without_room_to_turn_makes_a_detour(env):
    """Beside the place to pick from, turned a little: there is no room to turn to it."""
    worlds = [0, 2]
    for world in worlds:
        yaw, at = table_yaw(env, world), env.sim.object.views.pos[world, :2]
        along, left = [math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]
        stand_at(env, at - 0.715 * torch.tensor(along) - 0.14 * torch.tensor(left), world, yaw + 0.3)
        enter(env, ALIGN, world)
    handed_over = torch.zeros(NUM_WORLDS, dtype=torch.bool)
    for _ in range(280):
        env.step(idle(env))
        assert (env.outcome[worlds] == episode.RUNNING).all()
        handed_over |= env.stage == PICK
    assert handed_over[worlds].all()


def test_same_seed_same_bits_with_and_without_a_graph(make_fetch_env):
    def run(capture):
        env = make_fetch_env(num_envs=3, seed=5, capture=capture)
        env.set_cells([1, 2, 1], [0, 1, 2])
        env.reset()
        for world in (0, 1):
            stand_at(env, env.goal[world], world)
        generator = torch.Generator().manual_seed(1)
        rows = []
        for _ in range(12):
            action = 2 * torch.rand(3, 10, generator=generator) - 1
            obs, _, _, _ = env.step(action.to(env.device))
            rows.append({name: value.cpu().numpy() for name, value in obs.items()})
        return rows

    for first, second in zip(run(True), run(False), strict=True):
        for name in first:
            np.testing.assert_array_equal(first[name], second[name], err_msg=name)


def test_results_keep_the_first_fetch_of_every_world(env):
    """The second one has another object, ends in another stage and otherwise, and takes longer."""
    world = 0
    first, second = int(env.sim.object.views.kind[world]), "mug"
    assert OBJECTS[first] != second
    env.set_objects([second] * NUM_WORLDS)
    stand_at(env, env.goal[world] + torch.tensor([0.0, 0.45]), world)
    env.step(idle(env))
    result = env.results()
    env.step(idle(env))
    enter(env, ALIGN, world)
    put_object(env, [0.0, 0.0, 0.1], world)
    env.step(idle(env))
    assert env.outcome[world] == DROPPED
    stats = env.episode_stats()
    assert stats["episodes"] == 2 and stats["collision_rate"] == stats["dropped_rate"] == 0.5
    kept = env.results()
    assert kept.outcome[world] == episode.COLLISION and kept.stage[world] == REACH
    assert kept.kind[world] == first and kept.steps[world].sum() == 1
    for name, value in vars(result).items():
        np.testing.assert_array_equal(getattr(kept, name)[world], value[world], err_msg=name)
    env.reset()
    assert not env.results().ended.any()
