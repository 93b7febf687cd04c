"""Rounds of a benchmark: what a world is given must not depend on what a policy did before."""

import numpy as np
import pytest

from spin_rl.benchmark.metrics import Episodes
from spin_rl.benchmark.rounds import run_rounds
from spin_rl.tasks.common.config import CurriculumConfig
from spin_rl.tasks.common.episode import SUCCESS, TIMEOUT
from spin_rl.tasks.nav.config import NavConfig

NUM_WORLDS, ROUNDS = 4, 3


class Noting:
    """Stands still and notes the scene in which each round begins."""

    def __init__(self, env, arrives):
        self.env, self.arrives = env, arrives
        self.scenes = []
        self.begins = False

    def reset(self, dones=None):
        self.begins |= dones is None

    def __call__(self, obs):
        layout, views = self.env.sim.layout, self.env.sim.views
        if self.begins:
            scene = {name: getattr(layout, name).numpy().copy() for name in ("start", "start_joints", "goal")}
            active = layout.active.numpy().copy()
            scene |= {"active": active, "pos": layout.pos.numpy()[active]}
            dynamics = self.env.sim.dynamics
            scene |= {name: getattr(dynamics, name).numpy().copy() for name in ("lag", "speed_scale")}
            self.scenes.append(scene)
            self.begins = False
        if self.arrives:
            self.env.goal[:] = views.qpos[:, :2]
        return views.action.clone()


@pytest.fixture(scope="module")
def env(make_nav_env):
    # As benchmarks have it: scenes of one level, whoever drives.
    curriculum = CurriculumConfig(enabled=False, start=1.0)
    return make_nav_env(NavConfig(episode_s=0.6, curriculum=curriculum), NUM_WORLDS)


def run(env, arrives):
    """Scenes of every round, and the outcomes, of a policy that arrives in every step or in none."""
    env.reseed(5)
    policy = Noting(env, arrives)
    queue = np.zeros(NUM_WORLDS * ROUNDS, dtype=int)
    episodes = run_rounds(env, policy, queue, lambda _: None, dict, Episodes, report=lambda line: None)
    return policy.scenes, episodes.outcome


def test_scenes_of_later_rounds_do_not_depend_on_the_policy(env):
    """One policy starts every world anew in each step, the other one never."""
    (first, arrived), (second, stood) = run(env, True), run(env, False)
    assert (arrived == SUCCESS).all() and (stood == TIMEOUT).all()
    assert len(first) == len(second) == ROUNDS
    for number, (ours, theirs) in enumerate(zip(first, second, strict=True)):
        for name in ours:
            np.testing.assert_array_equal(ours[name], theirs[name], err_msg=f"{name} in round {number}")
    assert len({scene["start"].tobytes() for scene in first}) == ROUNDS, "each round has scenes of its own"
