"""The dynamic benchmark: its rows, its places, and how collisions are counted."""

import numpy as np
import pytest
import torch

from spin_rl.benchmark import dynamic, policies
from spin_rl.benchmark.metrics import mean_interval
from spin_rl.benchmark.tables import dynamic as tables
from spin_rl.planning.distance_field import CEILING_M
from spin_rl.scenes.scene_file import parse_scene
from spin_rl.tasks.nav.config import NavConfig

SMALL = {
    "start": {"position": [0, 0]},
    "goal": [5, 0],
    "walls": [{"position": [2.5, y], "size": [8, 0.1, 1]} for y in (2.0, -2.0)],
}


@pytest.fixture
def places(monkeypatch):
    monkeypatch.setattr(dynamic, "place", lambda name: parse_scene(SMALL))


def test_every_place_has_a_row_with_and_without_one_that_steps_in(places, device):
    lines = []
    result = dynamic.evaluate_dynamic(
        policies.open_policy("zero").make,
        NavConfig(slack_s=0.5, slowness=0.01),
        2,
        [0, 1],
        device,
        policy_name="zero",
        report=lines.append,
    )
    conditions = [(place, kind) for place in ("lab", "study") for kind in ("static", "dynamic")]
    assert [(row["scene"], row["obstacles"]) for row in result["rows"]] == conditions
    assert all(row["episodes"] == 4 and row["timeout_rate"] == 1.0 for row in result["rows"])
    assert all(row["collisions"] == 0.0 == row["collisions_ci95"][1] for row in result["rows"])
    assert result["benchmark"] == "dynamic" and result["throw"]["lying"] == 4
    text = tables.table(result).splitlines()
    assert text[0].startswith("Dynamic: zero, 4 episodes per row (seeds 0, 1)")
    # The paper's figures stand beside: success and collisions, of its method and of the classical stack.
    assert text[2].split()[-6:] == ["0.8", "1.0", "0.6", "0.4", "timeout", "100%"]
    assert text[5].split()[-6:] == ["0.6", "1.6", "0.2", "1.0", "timeout", "100%"]
    assert "0.00 collisions an episode" in tables.headline(result)


def test_an_episode_goes_on_after_a_collision(places, device, monkeypatch):
    class Ahead:
        def __call__(self, obs):
            actions = torch.zeros(obs.batch_size[0], 10, device=obs.device)
            actions[:, 0] = 1.0
            return actions

        def reset(self, dones=None):
            pass

    wall = SMALL | {"walls": [{"position": [1.0, 0.0], "size": [0.1, 3.0, 1.0]}, *SMALL["walls"]]}
    trips = [parse_scene(wall | {"start": {"position": [0, 0], "yaw": yaw}}) for yaw in (0.0, np.pi)]
    monkeypatch.setattr(dynamic, "_draw", lambda count, seed, report: [trips[0], trips[1]] * 2)
    result = dynamic.evaluate_dynamic(
        lambda obs, device: Ahead(), NavConfig(slack_s=3.0, slowness=0.01), 1, [0], device,
        report=lambda line: None,
    )  # fmt: skip
    hit, missed = result["rows"][:2]
    assert hit["collisions"] >= 1.0 and missed["collisions"] == 0.0
    assert hit["timeout_rate"] == missed["timeout_rate"] == 1.0 and hit["collision_rate"] == 0.0


def test_touching_counts_once_until_it_has_ended_for_a_while():
    counter = dynamic.CollisionCounter(1, "cpu")
    pattern = [0, 1, 1, 1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0]  # two steps apart are one, five are another
    counts = [int(counter.add(torch.tensor([bool(touch)]))) for touch in pattern]
    assert counts == [0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 2, 2]
    counter.restart()
    assert int(counter.add(torch.tensor([True]))) == 1


def test_the_papers_places_have_obstacles_on_the_floor_alone():
    for name in dynamic.SCENES:
        scene = dynamic.place(name)
        bottom, top = (scene.pos[:, 2] + sign * scene.half_size[:, 2] for sign in (-1, 1))
        reached = scene.active & (bottom < CEILING_M)
        assert reached.sum() > 60 and not scene.moves
        assert (bottom[reached] < 0.01).all() and (top[reached] > 0.2).all()


def test_interval_of_a_mean():
    assert mean_interval(np.zeros(20)) == (0.0, 0.0)
    rng = np.random.default_rng(0)
    covered = 0
    for _ in range(200):
        low, high = mean_interval(rng.poisson(1.0, 60), draws=400)
        covered += low <= 1.0 <= high
    assert 180 <= covered <= 199
