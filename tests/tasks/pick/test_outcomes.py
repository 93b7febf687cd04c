"""When a pick ends and what counts as one: the end of a step by tables of what it left behind."""

from dataclasses import dataclass

import pytest
import torch
import warp as wp

from spin_rl.tasks.common import episode
from spin_rl.tasks.pick.config import PickConfig
from spin_rl.tasks.pick.episode import DROPPED

GRASP = (8.0, 8.0)


@dataclass
class Left:
    """What a step leaves behind in one world."""

    height: float = 0.0
    fingers: tuple[float, float] = (0.0, 0.0)
    hard: float = 0.0
    support: bool = False
    length: int = 5
    held: int = 0
    succeeded: bool = False


def end(env, left: Left):
    """End a step that left this behind in every world; return the outcome of the first."""
    sim, progress = env.sim, env._progress
    sim.object.views.pos[:, 2] = sim.object.views.start_pose[:, 2] + left.height
    sim.grasp.views.finger_force[:] = torch.tensor(left.fingers)
    sim.grasp.views.hard_contact[:] = left.hard
    sim.grasp.views.object_support[:] = left.support
    env.episode_length_buf[:] = left.length
    wp.to_torch(progress.held)[:] = left.held
    wp.to_torch(progress.succeeded)[:] = left.succeeded
    with wp.ScopedDevice(env.device):
        env._end_episodes()
    return int(env.outcome[0])


@pytest.fixture(scope="module", params=[False, True], ids=["go on", "end on success"])
def env(request, make_pick_env):
    return make_pick_env(PickConfig(end_on_success=request.param), 2)


DOWN, UP = -0.2, 0.11


@pytest.mark.parametrize(
    ("left", "wanted", "ending"),
    [
        (Left(), episode.RUNNING, None),
        (Left(hard=29.0), episode.RUNNING, None),
        (Left(hard=31.0), episode.COLLISION, None),
        (Left(hard=31.0, height=DOWN), episode.COLLISION, None),
        (Left(height=DOWN), int(DROPPED), None),
        (Left(height=-0.04), episode.RUNNING, None),
        (Left(length=69), episode.TIMEOUT, None),
        (Left(length=68), episode.RUNNING, None),
        (Left(length=69, succeeded=True), episode.SUCCESS, None),
        (Left(hard=31.0, succeeded=True), episode.SUCCESS, None),
        (Left(height=DOWN, succeeded=True), episode.SUCCESS, None),
        (Left(UP, GRASP, held=8), episode.RUNNING, None),
        (Left(UP, GRASP, held=9), episode.RUNNING, episode.SUCCESS),
        (Left(UP, GRASP, held=9, length=69), episode.SUCCESS, None),
        (Left(UP, GRASP, hard=31.0, held=9), episode.COLLISION, None),
        (Left(UP, GRASP, hard=31.0, held=9, length=69), episode.COLLISION, None),
        (Left(UP, GRASP, hard=29.0, held=9), episode.RUNNING, episode.SUCCESS),
        (Left(UP, GRASP, hard=31.0, held=12, succeeded=True), episode.SUCCESS, None),
        (Left(0.09, GRASP, held=9), episode.RUNNING, None),
        (Left(UP, (5.5, 4.0), held=9), episode.RUNNING, None),
        (Left(UP, (12.0, 0.9), held=9), episode.RUNNING, None),
        (Left(UP, GRASP, support=True, held=9), episode.RUNNING, None),
    ],
)
def test_outcome(env, left, wanted, ending):
    if ending is not None and env.cfg.end_on_success:
        wanted = ending
    assert end(env, left) == wanted
    assert env._end.done.numpy().tolist() == [wanted != episode.RUNNING] * 2
    ended_by_time = wanted in (episode.TIMEOUT, episode.SUCCESS) and left.length == 69
    by_success = env.cfg.end_on_success and left.held == 9
    assert env._step_views.time_out[0] == (ended_by_time and not by_success)


def test_holding_counts_steps_in_a_row(env):
    held = wp.to_torch(env._progress.held)
    end(env, Left(UP, GRASP, held=3))
    assert held.tolist() == [4, 4]
    end(env, Left(UP, GRASP, support=True, held=3))
    assert held.tolist() == [0, 0]


def test_what_a_step_says(env):
    end(env, Left(0.03, (7.0, 4.0), hard=40.0))
    env.sim.object.views.pos[:] = env.sim.views.site_pos[:, env.observations._eef]
    env.sim.object.views.pos[1, 2] += 0.05
    with wp.ScopedDevice(env.device):
        env._end_episodes()
    step = env._transition(torch.zeros(2, 10))
    assert step.distance.tolist() == pytest.approx([0.0, 0.05], abs=1e-6)
    assert step.inside.tolist() == [True, False]
    assert step.finger_force.tolist() == [[7.0, 4.0]] * 2 and step.grasped.all() and step.pressed.all()
    assert step.collision.all() and not step.dropped.any() and not step.success.any()
    qpos = env.sim.views.qpos
    assert step.finger.tolist() == pytest.approx(qpos[:, 9:11].mean(-1).tolist(), abs=1e-6)


def test_the_largest_hard_force_is_kept_until_the_episode_ends(env):
    env.reset()
    seen = []
    for hard in (0.0, 3.0, 12.0, 5.0):
        end(env, Left(hard=hard))
        seen.append(env._transition(torch.zeros(2, 10)).hard_peak.tolist())
    assert seen == [[0.0] * 2, [3.0] * 2, [12.0] * 2, [12.0] * 2]
    # The other world's goes on.
    with wp.ScopedDevice(env.device):
        env._launch_reset(wp.array([True, False], dtype=bool))
    end(env, Left(hard=2.0))
    assert env._transition(torch.zeros(2, 10)).hard_peak.tolist() == [2.0, 12.0]
