"""A whole fetch by hand-written policies: every stage in its turn, with a real grasp and a real way back."""

import numpy as np
import pytest
import torch
import warp as wp

from spin_rl import robot
from spin_rl.tasks.common import episode
from spin_rl.tasks.fetch.config import STAGES, FetchConfig, StageLimits
from spin_rl.tasks.fetch.env import FetchEnv
from spin_rl.tasks.fetch.policy import FetchPolicy
from spin_rl.tasks.fetch.state import PICK

NUM_WORLDS = 4
# Where the object is in the hand at which the fingers close: the gripper holds it with its tips.
CLOSE_AT_M = 0.012
FORWARD, TURN, LIFT, ARM, FINGER = (
    robot.ACTIONS.index(name)
    for name in ("base_forward", "base_turn", "lift", "arm_extension", "gripper_finger")
)


class DriveStraight:
    """Turns to the goal and drives there; nothing is in the way in the corridors of this seed."""

    def __call__(self, obs):
        goal = obs["goal"]
        off = torch.atan2(goal[:, 1], goal[:, 0])
        action = torch.zeros(len(goal), len(robot.ACTIONS))
        action[:, TURN] = (1.5 * off).clamp(-0.5, 0.5)
        action[:, FORWARD] = (0.5 * (off.abs() < 0.2)).float()
        return action

    def reset(self, dones=None):
        pass


class GraspAhead:
    """Down to the object's height, out to it, close, up: by where hand and object are, in the base frame."""

    def __init__(self):
        self.closing = torch.zeros(NUM_WORLDS)

    def __call__(self, obs):
        at = obs["object"][:, 1:4]
        # The hand in the base frame, in proprio before the last action; the arm points to -y.
        centre = obs["proprio"][:, 18:21]
        out, up = centre[:, 1] - at[:, 1], at[:, 2] - centre[:, 2]
        seen = obs["object"][:, 0] > 0.5
        aside = (at[:, 0] - centre[:, 0]).abs()
        near = seen & (out.abs() < CLOSE_AT_M) & (up.abs() < 0.02) & (aside < 0.05)
        self.closing = torch.where(near | (self.closing > 0), self.closing + 1, self.closing)
        closing = self.closing > 0
        action = torch.zeros(len(at), len(robot.ACTIONS))
        action[:, LIFT] = (8.0 * up).clamp(-1.0, 1.0)
        action[:, ARM] = torch.where(up.abs() < 0.03, (6.0 * out).clamp(-1.0, 1.0), torch.zeros_like(out))
        action[closing, LIFT] = torch.where(self.closing > 8, 0.4, 0.0)[closing]
        action[closing, ARM] = 0.0
        action[:, FINGER] = torch.where(closing, -1.0, 0.2)
        return action

    def reset(self, dones=None):
        if dones is None:
            self.closing.zero_()
        else:
            self.closing[dones.bool()] = 0.0


@pytest.mark.slow
@pytest.mark.parametrize("detector", ["none", "segmentation"])
def test_a_fetch_by_hand_written_policies_goes_through_every_stage(device, detector):
    env = FetchEnv(FetchConfig(object="can", detector=detector), NUM_WORLDS, device, seed=4)
    env.set_cells([1] * NUM_WORLDS, [0] * NUM_WORLDS)
    obs = env.reset()
    policy = FetchPolicy(DriveStraight(), GraspAhead())
    seen = [[] for _ in range(NUM_WORLDS)]
    for _ in range(round(90 / env.cfg.sim.control_period)):
        for world in range(NUM_WORLDS):
            name = STAGES[int(env.stage[world])]
            if not env.results().ended[world] and (not seen[world] or seen[world][-1] != name):
                seen[world].append(name)
        obs, _, done, _ = env.step(policy(obs))
        policy.reset(done)
        if env.results().ended.all():
            break
    results = env.results()
    for world in range(NUM_WORLDS):
        assert results.outcome[world] == episode.SUCCESS, results.cause(world)
        assert seen[world] == list(STAGES), "no stage is left out or done twice"
        assert results.picked[world] and results.drops[world] == 0
        assert results.distance[world] < env.cfg.place_m
    np.testing.assert_array_equal(results.steps, results.stage_steps.sum(1))


class GraspTimidly(GraspAhead):
    """In a world's first attempt it lifts too little for a pick, and holds."""

    def __init__(self):
        super().__init__()
        self.timid = torch.ones(NUM_WORLDS, dtype=torch.bool)

    def __call__(self, obs):
        action = super().__call__(obs)
        action[self.timid & (self.closing > 13), LIFT] = 0.0
        return action

    def reset(self, dones=None):
        if dones is not None:
            self.timid &= ~(dones.bool() & (self.closing > 13))
        super().reset(dones)


@pytest.mark.slow
def test_what_a_failed_pick_holds_is_put_down_before_the_next(device):
    cfg = FetchConfig(object="can", limits=StageLimits(pick=7.0))
    env = FetchEnv(cfg, NUM_WORLDS, device, seed=4)
    env.set_cells([1] * NUM_WORLDS, [0] * NUM_WORLDS)
    obs = env.reset()
    stood = env.sim.object.views.pos.clone()
    policy = FetchPolicy(DriveStraight(), GraspTimidly())
    retries = wp.to_torch(env._state.retries)
    lifted = torch.zeros(NUM_WORLDS)
    again = torch.zeros(NUM_WORLDS, dtype=torch.bool)
    for _ in range(650):
        obs, _, done, _ = env.step(policy(obs))
        policy.reset(done)
        assert not (done.bool() & ~again).any()
        at = env.sim.object.views
        lifted = torch.maximum(lifted, torch.where(retries == 0, at.pos[:, 2] - stood[:, 2], 0.0))
        fell = (retries == 1) & ~again & (at.velocity[:, 2] < -0.3)
        assert not fell.any(), "it is lowered, not dropped"
        again |= (retries > 0) & (env.stage == PICK)
        if again.all():
            break
    assert again.all()
    assert (lifted > 0.02).all() and (lifted < cfg.lift_m).all(), "the first attempt lifts too little"
    assert (at.quat[:, 1:3].norm(dim=1) < 0.02).all(), "it stands again"
