from types import SimpleNamespace

import numpy as np
import pytest
import torch

from spin_rl import robot
from spin_rl.benchmark import policies, reach, rounds
from spin_rl.benchmark.metrics import spl
from spin_rl.config import ConfigError
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.scenes.scene_file import load_scene
from spin_rl.tasks.common import episode
from spin_rl.tasks.nav.config import NavConfig

BASE, ARM = robot.PARTS.index("base"), robot.PARTS.index("arm")


class FakeEnv:
    """A world's first episode succeeds after 2 + cell steps, all later ones crash after one step."""

    max_episode_length = 20

    def __init__(self, num_envs):
        self.num_envs = num_envs
        self.device = "cpu"
        self.cell = torch.zeros(num_envs, dtype=torch.int64)
        self.cells_set = []
        self.resets = 0

    def set_cells(self, scenario, difficulty):
        assert len(scenario) == len(difficulty) == self.num_envs
        self.cell = torch.tensor([(s - 1) * 3 + d for s, d in zip(scenario, difficulty, strict=True)])
        self.cells_set.append(self.cell)

    def set_episode(self, index):
        assert index == self.resets  # each round draws the next episode, whatever the policy did

    def reset(self):
        self.resets += 1
        self.age = torch.zeros(self.num_envs, dtype=torch.int64)
        self.episode = torch.zeros(self.num_envs, dtype=torch.int64)
        return torch.zeros(self.num_envs, 1)

    def step(self, actions):
        assert actions.shape == (self.num_envs, 10)
        self.age += 1
        first = self.episode == 0
        success = first & (self.age == 2 + self.cell)
        crash = ~first
        self.outcome = torch.where(success, episode.SUCCESS, torch.where(crash, episode.COLLISION, 0)).int()
        done = success | crash
        self.last_transition = SimpleNamespace(goal_distance=0.01 * self.cell + crash)
        parts = torch.zeros(self.num_envs, len(robot.PARTS), dtype=torch.bool)
        parts[:, BASE] = crash
        parts[:, ARM] = success  # so that the bookkeeping's choice of step shows
        self.final_way, self.final_driven = torch.ones(self.num_envs), torch.full((self.num_envs,), 2.0)
        self.sim = SimpleNamespace(views=SimpleNamespace(part_contacts=parts))
        self.age[done] = 0
        self.episode[done] += 1
        return torch.zeros(self.num_envs, 1), torch.zeros(self.num_envs), done.long(), {}


class RecordingPolicy:
    def __init__(self, num_envs):
        self.num_envs = num_envs
        self.full_resets = 0
        self.dones = []

    def __call__(self, obs):
        return torch.zeros(self.num_envs, 10)

    def reset(self, dones=None):
        if dones is None:
            self.full_resets += 1
        else:
            self.dones.append(dones.clone())


@pytest.mark.parametrize("num_envs", [1, 4, 7, 18, 25])
@pytest.mark.parametrize("episodes", [1, 3])
def test_first_episodes_only_and_exact_counts(num_envs, episodes):
    env, policy = FakeEnv(num_envs), RecordingPolicy(num_envs)
    groups = reach.run_cells(env, policy, reach.REACH_CELLS, episodes, report=lambda line: None)
    assert [len(group.outcome) for group in groups] == [episodes] * 6
    for cell, group in enumerate(groups):
        # A second episode would be a collision after one step.
        assert (group.outcome == episode.SUCCESS).all()
        assert (group.steps == 2 + cell).all()
        assert spl(group.outcome == episode.SUCCESS, group.way, group.driven) == 0.5
        assert group.distance == pytest.approx(0.01 * cell)
        assert group.parts[:, ARM].all() and not group.parts[:, BASE].any()
    rounds = -(-6 * episodes // num_envs)
    assert env.resets == policy.full_resets == rounds


def test_recurrent_state_is_cleared_when_worlds_end():
    env, policy = FakeEnv(6), RecordingPolicy(6)
    reach.run_cells(env, policy, reach.REACH_CELLS, 1, report=lambda line: None)
    assert torch.cat([dones[:1] for dones in policy.dones]).tolist()[:3] == [0, 1, 1]


def test_one_fixed_scene_leaves_the_cells_alone():
    env, policy = FakeEnv(4), RecordingPolicy(4)
    (group,) = reach.run_cells(env, policy, (reach.Cell("room.yaml", "scene"),), 5, report=lambda line: None)
    assert len(group.outcome) == 5
    assert env.cells_set == []


def test_an_endless_episode_is_an_error():
    env, policy = FakeEnv(6), RecordingPolicy(6)
    env.max_episode_length = 3
    with pytest.raises(RuntimeError, match="time limit"):
        reach.run_cells(env, policy, reach.REACH_CELLS, 1, report=lambda line: None)


def test_progress_ends_with_all_episodes():
    lines = []
    reach.run_cells(FakeEnv(4), RecordingPolicy(4), reach.REACH_CELLS, 1, report=lines.append)
    assert lines[-1].startswith("6 of 6 episodes")


@pytest.mark.parametrize(
    ("episodes", "num_envs", "device", "expected"),
    [
        (600, None, "cpu", 600),
        (601, None, "cpu", 301),
        (600, 64, "cpu", 60),
        (6, 64, "cpu", 6),
        (7, 1, "cpu", 1),
        (6000, None, "cuda:0", 6000),
    ],
)
def test_batch_size(episodes, num_envs, device, expected):
    assert rounds.batch_size(episodes, num_envs, device) == expected


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        ((0, [0], None), "episodes"),
        ((1, [], None), "seeds"),
        ((1, [1, 1], None), "seeds"),
        ((1, [0], 0), "num_envs"),
    ],
)
def test_impossible_counts_name_the_key(arguments, key):
    episodes, seeds, num_envs = arguments
    with pytest.raises(ConfigError, match=f"^{key}:"):
        reach.evaluate_reach(None, None, episodes, seeds, "cpu", num_envs=num_envs)


def test_a_scene_file_is_one_row(tmp_path, device):
    path = tmp_path / "room.yaml"
    path.write_text(
        "start: {position: [0, 0], yaw: 0}\n"
        "goal: [2, 0]\n"
        "boxes:\n  - {position: [1, 2], size: [0.1, 0.1, 0.5]}\n"
    )
    result = reach.evaluate_reach(
        policies.open_policy("zero").make,
        NavConfig(episode_s=0.5),
        episodes=3,
        seeds=[0],
        device=device,
        num_envs=2,
        scene=load_scene(path),
        scene_name=path.name,
    )
    (row,) = result["rows"]
    assert (row["scenario"], row["difficulty"], row["episodes"]) == ("room.yaml", "scene", 3)
    assert row["timeout_rate"] == 1.0
    assert row["final_distance_m"] == pytest.approx(2.0, abs=0.01)


def test_a_scene_gets_the_usual_slots_or_more():
    scene = Scene.empty(PoolSpec(num_walls=1, num_boxes=30, num_cylinders=1))
    scene.active[:] = True
    scene.pos[:, 0] = np.arange(32)
    scene.goal[:] = (3.0, 1.0)
    grown = reach.in_usual_pool(scene)
    assert grown.pool == PoolSpec(num_walls=6, num_boxes=30, num_cylinders=3)
    # Walls, boxes and cylinders are in their own slots, the added ones are empty.
    assert grown.pos[grown.active, 0].tolist() == list(range(32))
    assert np.flatnonzero(grown.active).tolist() == [0, *range(6, 36), 36]
    assert grown.goal.tolist() == [3.0, 1.0]
