"""One policy out of two: who acts when, and with an empty memory at the start of its stage."""

import torch
from tensordict import TensorDict

from spin_rl.tasks.fetch.config import STAGES
from spin_rl.tasks.fetch.policy import FetchPolicy


class Counting:
    """Returns the number of steps since its memory of a world was cleared, times a sign."""

    def __init__(self, num_envs, sign):
        self.steps = torch.zeros(num_envs)
        self.sign = sign

    def __call__(self, obs):
        self.steps += 1
        return (self.sign * self.steps)[:, None].expand(-1, 10)

    def reset(self, dones=None):
        if dones is None:
            self.steps.zero_()
        else:
            self.steps[dones > 0] = 0


def observe(*names):
    stage = torch.tensor([[float(STAGES.index(name))] for name in names])
    return TensorDict({"stage": stage}, batch_size=[len(names)])


def test_actions_are_selected_by_stage_and_memory_starts_fresh():
    policy = FetchPolicy(Counting(3, 1.0), Counting(3, -1.0))
    rows = [
        ("reach", "reach", "pick"),
        ("reach", "align", "pick"),
        ("reach", "pick", "retract"),
        ("reach", "pick", "carry"),
        ("reach", "align", "carry"),
        ("reach", "pick", "carry"),
    ]
    seen = [policy(observe(*row))[:, 0].tolist() for row in rows]
    # The first world's navigation is never cleared, the others' at every change of stage.
    assert [row[0] for row in seen] == [1, 2, 3, 4, 5, 6]
    assert [row[1] for row in seen] == [1, 1, -1, -2, 1, -1]
    assert [row[2] for row in seen] == [-1, -2, 1, 1, 2, 3]


def test_reset_clears_the_worlds_that_are_done():
    nav, pick = Counting(2, 1.0), Counting(2, -1.0)
    policy = FetchPolicy(nav, pick)
    for _ in range(3):
        policy(observe("reach", "pick"))
    policy.reset(torch.tensor([1, 0]))
    assert policy(observe("reach", "pick"))[:, 0].tolist() == [1, -4]
    policy.reset()
    # In the same stages, so that no change of stage clears them.
    assert policy(observe("reach", "pick"))[:, 0].tolist() == [1, -1]
