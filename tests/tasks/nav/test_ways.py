"""How far it is to the goal and how long an episode may take, by fields whose values are known."""

import numpy as np
import pytest
import warp as wp
from nav_steps import BEFORE_M, Left, corridors, end_step

from spin_rl import robot
from spin_rl.planning.distance_field import DistanceField, GridSpec
from spin_rl.scenes.layout import Layout
from spin_rl.scenes.rooms.params import FamilyParams
from spin_rl.tasks.common.episode import RUNNING, TIMEOUT
from spin_rl.tasks.nav.episode import begin_episodes, make_trips
from spin_rl.tasks.nav.ways import field_ways, most_steps
from spin_rl.warp_kernels.distance_field.field import UNREACHABLE

SCENE = FamilyParams(way=(0.5, 10.0))
PROFILE = robot.SPEED_PROFILES["paper"]
GRID = GridSpec.square(6.0, 0.5)
GOAL = (1.2, -0.7)
PERIOD_S, SLACK_S, SLOWNESS = 0.1, 8.0, 2.5
NOWHERE = np.inf


def ways_with(detours, device):
    """Ways that are longer than the straight line by so much [m] everywhere in a world, or lead nowhere."""
    layout = Layout(len(detours), SCENE.pool, device)
    field = DistanceField(layout, device, GRID)
    middles = GRID.origin[0] + GRID.cell_m * (0.5 + np.arange(GRID.nx))
    straight = np.hypot(middles[None, :] - GOAL[0], middles[:, None] - GOAL[1])
    values = straight + np.array(detours)[:, None, None]
    field.field.values.assign(np.minimum(values, UNREACHABLE).astype(np.float32))
    field.field.goal.assign([GOAL] * len(detours))
    return field_ways(
        layout,
        field,
        PROFILE,
        longest_m=SCENE.way[1],
        period=PERIOD_S,
        slack_s=SLACK_S,
        slowness=SLOWNESS,
    )


def begin(ways, at, device, *, speed_scale=None, mask=None):
    """Begin an episode in every world or in the masked ones; return ways [m], -1 before, and time limits."""
    n = len(at)
    qpos = np.zeros((n, len(robot.DOF_NAMES)), np.float32)
    qpos[:, :2] = at
    with wp.ScopedDevice(device):
        distance = wp.full(n, -1.0, dtype=float)
        goal = wp.array([GOAL] * n, dtype=wp.vec2)
        wp.launch(
            begin_episodes,
            dim=n,
            inputs=[
                wp.array([True] * n if mask is None else mask, dtype=bool),
                wp.array(qpos),
                goal,
                goal,
                wp.array([1.0] * n if speed_scale is None else speed_scale, dtype=float),
            ],
            outputs=[ways, make_trips(n, device), distance],
        )
    return distance.numpy(), ways.most_steps.numpy()


def limit_s(way, scale=1.0):
    return SLACK_S + SLOWNESS * way / (PROFILE.forward_max * scale)


def test_a_new_episode_may_take_as_long_as_its_way(device):
    at = np.random.default_rng(0).uniform(-2.0, 2.0, (5, 2))
    straight = np.hypot(*(at - GOAL).T)
    scales = [1.0, 0.7, 1.2, 1.0, 0.7]
    ways = ways_with([0.0, 0.0, 3.0, 6.0, 1.5], device)
    distance, steps = begin(ways, at, device, speed_scale=scales)
    np.testing.assert_allclose(distance, straight + [0.0, 0.0, 3.0, 6.0, 1.5], atol=1e-5)
    wanted = [limit_s(way, scale) / PERIOD_S for way, scale in zip(distance, scales, strict=True)]
    np.testing.assert_allclose(steps, wanted, atol=1.0)


def test_time_limits_are_bounded(device):
    """By 1.2 times the longest way that starts are drawn for, at the lowest speed."""
    ways = ways_with([50.0, 50.0], device)
    _, steps = begin(ways, [(0.0, 0.0)] * 2, device, speed_scale=[1.0, 0.8])
    np.testing.assert_allclose(steps, [limit_s(12.0) / PERIOD_S, limit_s(12.0, 0.8) / PERIOD_S], atol=1.0)
    assert most_steps(ways, 0.8) == pytest.approx(steps[1], abs=1.0)


def test_without_a_way_the_straight_line_counts_at_first_and_later_nothing(device):
    """The base's front may be under something that the mast cannot pass."""
    ways = ways_with([NOWHERE, 0.0], device)
    distance, steps = begin(ways, [(-0.8, -0.7)] * 2, device)
    np.testing.assert_allclose(distance, 2.0, atol=1e-5)
    np.testing.assert_allclose(steps, limit_s(2.0) / PERIOD_S, atol=1.0)
    ended = end_step([Left(way=(1.0, 0.0), length=0)], device, ways=ways)
    assert ended["progress"] == 0.0 and ended["distance"] == BEFORE_M and ended["straight"] == 1.0


def test_only_masked_worlds_begin(device):
    ways = ways_with([1.0, 1.0], device)
    ways.most_steps.fill_(7)
    distance, steps = begin(ways, [(0.0, 0.0)] * 2, device, mask=[False, True])
    assert distance[0] == -1.0 and steps[0] == 7
    assert distance[1] > 2.0 and steps[1] > 7


def test_corridors_have_one_time_limit_and_ways_along_their_legs(device):
    """0.8 and 0.7 m to go."""
    ways = corridors([Left(), Left(bend=1)], device)
    before = ways.most_steps.numpy().copy()
    distance, steps = begin(ways, [(0.4, 0.0)] * 2, device, speed_scale=[0.5, 0.5])
    np.testing.assert_allclose(distance, [np.hypot(0.8, 0.7), 1.5], atol=1e-5)
    np.testing.assert_array_equal(steps, before)


def test_every_world_has_its_own_time_limit(device):
    ways = ways_with([0.0, 0.0, 0.0], device)
    ways.most_steps.assign([4, 5, 6])
    ended = end_step([Left(length=4)] * 3, device, ways=ways)
    assert ended["outcome"].tolist() == [TIMEOUT, TIMEOUT, RUNNING]
