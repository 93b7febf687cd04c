"""Where the robot was when an image was taken, and that the map goes by it."""

import numpy as np
import pytest
from conftest import ScriptedNetwork
from fake_robot import STATE, STOWED
from pilot_worlds import ROOM, SCANDOTS, camera_at, contract, distance_to, picture, state_at, stowed

from spin_rl.deploy.agent import Agent, Inputs
from spin_rl.deploy.interface import RobotState
from spin_rl.deploy.pilot.track import Track


def moving(stamp_s, base, joints=STOWED):
    return RobotState(stamp_s, joints, np.zeros(8), np.array(base, dtype=float), np.zeros(2))


def test_it_interpolates_as_numpy_does_and_stays_at_its_ends():
    rng = np.random.default_rng(0)
    stamps, track = np.cumsum(rng.uniform(0.05, 0.2, 10)), Track()
    bases, joints = rng.uniform(-1.0, 1.0, (10, 3)), rng.normal(size=(10, 8))
    for stamp, base, values in zip(stamps, bases, joints, strict=True):
        track.add(moving(stamp, base, values))
    for time in [*rng.uniform(0.0, stamps[-1] + 0.5, 40), *stamps]:
        told = np.concatenate(track.at(time))
        wanted = [np.interp(time, stamps, column) for column in (*joints.T, *bases.T)]
        np.testing.assert_allclose(told, wanted, atol=1e-12)


def test_it_turns_the_short_way_and_forgets_what_is_long_ago():
    track = Track()
    track.add(moving(0.0, (0.0, 0.0, 3.1)))
    track.add(moving(0.1, (0.0, 0.0, -3.1)))
    assert np.cos(track.at(0.05)[1][2]) == pytest.approx(-1.0)
    for tick in range(2, 100):
        track.add(moving(0.1 * tick, (tick, 0.0, 0.0)))
    assert track.at(0.0)[1][0] == pytest.approx(84.0)


def test_a_later_state_of_the_same_time_takes_the_place_of_the_first():
    track = Track()
    for x in (1.0, 2.0):
        track.add(moving(0.3, (x, 0.0, 0.0)))
        assert track.at(0.3)[1][0] == x


@pytest.mark.parametrize(("is_told", "most_m"), [(True, 0.03), (False, None)])
def test_old_images_are_put_where_they_were_taken(is_told, most_m):
    """The robot turns and its images are two ticks old: walls are where they are if it knows of when."""
    agent = Agent(ScriptedNetwork(contract(), ((0.0,) * 10,)))
    agent.reset(STATE, np.array([2.0, 0.0]))
    told = {"scandots": np.zeros((1, SCANDOTS), dtype=np.float32)}
    bases, joints = [np.array([0.0, 0.0, 0.15 * tick]) for tick in range(25)], stowed()
    for tick, base in enumerate(bases):
        then = max(tick - 2, 0)
        image = picture(ROOM, camera_at(joints, bases[then]))
        state = moving(0.1 * tick, base, joints)
        agent.observe(Inputs(state, image, told, 0.1 * then if is_told else None))
    middle, _ = agent.pilot.costmap.boxes()
    inner = distance_to([(low, high) for low, high in ROOM], np.column_stack([middle, np.ones(len(middle))]))
    assert len(middle) > 100
    assert inner.max() < most_m if is_told else inner.max() > 0.2


def test_without_a_time_an_image_is_of_the_state():
    agent = Agent(ScriptedNetwork(contract(), ((0.0,) * 10,)))
    agent.reset(STATE, np.array([2.0, 0.0]))
    told = {"scandots": np.zeros((1, SCANDOTS), dtype=np.float32)}
    state = state_at((0.4, 0.0, 0.2), joints=stowed())
    agent.observe(Inputs(state, picture(ROOM, camera_at(state.joints, state.base)), told))
    middle, _ = agent.pilot.costmap.boxes()
    assert distance_to(ROOM, np.column_stack([middle, np.ones(len(middle))])).max() < 0.03
